"""Makes what a page shows of incident files: what became of a request, and what there is to save or fetch."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from companion.wire.delivery import Pending
from companion.wire.incidents import SHORT, Incidents

_KINDS = {SHORT: "the short file", "": "the whole file"}


def shown(
    told: Incidents, call: int, asked: Pending | None, more: Callable[[str, int], dict[str, Any]]
) -> dict[str, Any]:
    """Return what a page shows of the incident files of a call; 0: of the last minute.

    told: by the rover. asked: the newest request for it from this page, None without one. more: returns how a
    file of this name and of so many bytes can be had: "url", or how it is fetched.
    """
    newest, failed = told.newest(call), told.failed
    packing, waits = told.packing == call, asked is not None and not asked.settled
    texts = []
    if failed is not None and failed[0] == call:
        texts.append(f"It could not be packed: {failed[1]}.")
    if asked is not None and not packing and not asked.applied:
        texts.append(f"The request: {asked.told}.")
    if packing:
        texts.append("It is being packed.")
    files = []
    if newest is not None and not packing:
        texts += [f"It is {newest.note}."] if newest.note else []
        for kind, size in ((SHORT, newest.short), ("", newest.size)):
            name = f"{newest.name}{kind}.zip"
            files.append({"name": name, "what": _KINDS[kind], "bytes": size, **more(name, size)})
    return {"text": " ".join(texts), "busy": packing or waits, "packing": packing, "files": files}
