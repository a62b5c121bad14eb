"""Makes what the page shows of calls, from what the supervisor told and from their records."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from companion.pages import wording
from companion.pages.calls import named_thing, nearest, shown
from companion.pages.given import OwnAnswers
from companion.wire.call_report import PICTURES, RECORD_MEMBERS, CallReport, NearestScene, picture_path
from companion.wire.documents import StateFile, state_from
from companion.wire.ids import PAGE_SENDER
from companion.wire.json_values import DocumentError
from companion.wire.parameters import THR_SCENE

_MOST_NAMES = 24


def shown_calls(
    state: Mapping[str, Any],
    told_at: float,
    records: Sequence[Mapping[str, Any]],
    address: Callable[[str], str],
    own: Mapping[int, OwnAnswers],
    incident: Callable[[int], dict[str, Any] | None] = lambda _call: None,
) -> dict[str, Any]:
    """Return what the page shows of calls: the open call or hold, the newest before it, and their words.

    With them come the result of the newest answer to no call, such as words alone, and the incident files of
    the last minute.

    state: content of /state.json. told_at: when that was so, monotonic seconds. records: of the newest calls,
    the newest first. address: makes the address of a picture from its path, "" where there is none. own:
    answers on the page, by call. incident: returns the incident files of a call, or of the last minute for
    id 0; None where nobody may ask for such files.
    """
    now, kept = state_from(state), {}
    for written in records:
        try:
            read = CallReport.read(written, RECORD_MEMBERS)
        except DocumentError:
            continue
        kept[read.id] = read
    current, found = now.open_call, []

    def show(call: CallReport, record: CallReport | None, since: float | None = None) -> None:
        here = own.get(call.id) or OwnAnswers()
        there = record.nearest if record is not None else None
        alike = None if there is None else _nearest(there, now, kept, address, own)
        found.append(_shown(call, record, since, alike, address, here) | {"incident": incident(call.id)})

    if current is not None:
        show(current, kept.get(current.id), told_at - current.age_s)
    for record in kept.values():
        if current is None or record.id != current.id:
            show(record, record)
    names: dict[str, float] = {}
    for one in kept.values():
        names = wording.named(one) | names
    there = {call["id"] for call in found}
    alone = [one for number, its in own.items() if number not in there for one in its.answers]
    newest = sorted(alone, key=lambda one: one.pending.created)[-1:]
    return {
        "calls": found,
        "names": list(names.items())[:_MOST_NAMES],
        "alone": [one.document() for one in newest],
        "last_minute": incident(0),
    }


def _nearest(
    found: NearestScene,
    state: StateFile,
    known: Mapping[int, CallReport],
    address: Callable[[str], str],
    own: Mapping[int, OwnAnswers],
) -> dict[str, Any]:
    """Return what was answered in the scene most like a call's."""
    call = found.call_id or 0
    there = known.get(call)
    motion = wording.newest_motion([one.motion for one in there.answers]) if there is not None else ""
    picture = address(found.picture) if found.picture else ""
    named = named_thing(own.get(call) or OwnAnswers(), there) if call else None
    return nearest(found, "the answer was", motion, state.settings.get(THR_SCENE), picture, named)


def _shown(
    call: CallReport,
    record: CallReport | None,
    since: float | None,
    alike: Mapping[str, Any] | None,
    address: Callable[[str], str],
    own: OwnAnswers,
) -> dict[str, Any]:
    """Return what is shown of a call: pictures, what was answered to it, and what was in a similar scene."""
    pictures = {size: address(picture_path(call.id, size)) for size in PICTURES}
    ours = {(PAGE_SENDER, one.pending.answer.transaction) for one in own.answers}
    recorded = record.answers if record is not None else ()
    given = [one for one in recorded if (one.sender, one.transaction) not in ours]
    return shown(
        call,
        own,
        key=str(call.id),
        pictures={size: url for size, url in pictures.items() if url},
        said=[{"at": one.at, "text": wording.answered(one)} for one in given if one.at is not None],
        nearest=alike,
        since=since,
    ) | {
        "large": {},
        "given": [wording.answered(one) for one in given if one.at is None],
        "first": wording.first_answer(record, None) if record is not None and own.too_late else "",
    }
