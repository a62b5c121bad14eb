"""Makes what the page shows of calls, from what the supervisor told and from their records."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from companion.pages import wording
from companion.pages.given import Own, too_late, undoing, undone_words
from companion.wire.call_report import PICTURES, RECORD, CallReport, picture_path
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
    own: Mapping[int, Own],
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
    for record in records:
        try:
            read = CallReport.read(record, RECORD)
        except DocumentError:
            continue
        kept[read.id] = read
    current, found = now.open_call, []
    if current is not None:
        told = wording.announced(current) | {"since": round(told_at - current.age_s, 2)}
        found.append(told | _more(current, kept.get(current.id), now, kept, address, own))
    found += [
        wording.recorded(record) | _more(record, record, now, kept, address, own)
        for record in kept.values()
        if current is None or record.id != current.id
    ]
    names: dict[str, float] = {}
    for one in kept.values():
        names = wording.named(one) | names
    for call in found:
        call["incident"] = incident(call["id"])
    there = {call["id"] for call in found}
    alone = [one for number, (answers, _) in own.items() if number not in there for one in answers]
    newest = sorted(alone, key=lambda one: one.pending.created)[-1:]
    return {
        "calls": found,
        "names": list(names.items())[:_MOST_NAMES],
        "alone": [one.document() for one in newest],
        "last_minute": incident(0),
    }


def _more(
    call: CallReport,
    record: CallReport | None,
    state: StateFile,
    known: Mapping[int, CallReport],
    address: Callable[[str], str],
    own: Mapping[int, Own],
) -> dict[str, Any]:
    """Return pictures of a call, what was answered to it, and what was in a similar scene."""
    answers, undone = own.get(call.id, ((), None))
    pictures = {size: address(picture_path(call.id, size)) for size in PICTURES}
    ours = {(PAGE_SENDER, one.pending.answer.transaction) for one in answers}
    recorded = record.answers if record is not None else ()
    given = [one for one in recorded if (one.sender, one.transaction) not in ours]
    found = record.nearest if record is not None else None
    nearest = None
    if found is not None:
        there = known.get(found.call_id or 0)
        motion = wording.newest_motion([one.motion for one in there.answers]) if there is not None else ""
        alike = state.settings.get(THR_SCENE)
        picture = address(found.picture) if found.picture else ""
        nearest = wording.nearest(found, "the answer was", motion, alike, picture)
    return {
        "id": call.id,
        "key": str(call.id),
        "pictures": {size: url for size, url in pictures.items() if url},
        "large": {},
        "given": [wording.answered(one) for one in given if one.at is None],
        "said": [{"at": one.at, "text": wording.answered(one)} for one in given if one.at is not None],
        "answers": [one.document() for one in answers],
        "first": wording.first_answer(record, None) if record is not None and too_late(answers) else "",
        "undo": undone_words(undoing(answers, undone)),
        "undone": undone.told if undone is not None else None,
        "nearest": nearest,
    }
