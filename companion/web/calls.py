"""Makes what the page shows of calls, from what the supervisor told and from their records."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

from companion.browser import wording
from companion.wire.documents import (
    PICTURES,
    CallRecord,
    DocumentError,
    StateFile,
    picture_path,
    record_from,
    state_from,
)
from companion.wire.parameters import THR_SCENE
from companion.wire.payloads import CallData


def shown_calls(
    state: Mapping[str, Any],
    told_at: float,
    records: Sequence[Mapping[str, Any]],
    address: Callable[[str], str],
) -> list[dict[str, Any]]:
    """Return the calls for the page, the open call or hold first, then the newest.

    state: what /state.json has. told_at: monotonic seconds when it was so. records: of the newest calls, the
    newest first. address: makes the address of a picture from its path, "" where there is none.
    """
    now, kept = state_from(state), {}
    for record in records:
        try:
            read = record_from(record)
        except DocumentError:
            continue
        kept[read.id] = read
    current, found = now.open_call, []
    if current is not None:
        told = wording.announced(current) | {"since": round(told_at - current.age_s, 2)}
        found.append(told | _more(current, kept.get(current.id), now, kept, address))
    return found + [
        wording.recorded(record) | _more(record, record, now, kept, address)
        for record in kept.values()
        if current is None or record.id != current.id
    ]


def _more(
    call: CallData | CallRecord,
    record: CallRecord | None,
    state: StateFile,
    known: Mapping[int, CallRecord],
    address: Callable[[str], str],
) -> dict[str, Any]:
    """Return pictures of a call, what was answered to it, and what was in a similar scene."""
    pictures = {size: address(picture_path(call.id, size)) for size in PICTURES}
    given = record.answers if record is not None else ()
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
        "answers": [],
        "nearest": nearest,
    }
