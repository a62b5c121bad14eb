"""Resolves a typed command: which rover, which call and which frame it means."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

from anytraverse.operations import taps_of
from companion.wire.answers import Answer
from companion.wire.documents import FROM_ABOVE
from companion.wire.ids import Motion
from companion.wire.typed_answers import CommandError, placed
from gcs_plugin.client.rovers import TrackedRover
from gcs_plugin.terminal.commands import FetchPicture

READ_S = 2.0
"""An answer without an id is refused for this long after a new current call is shown: the operator may mean
the call before it."""


def choose_rover(
    rovers: Mapping[int, TrackedRover], named: int | None, selected: int | None = None
) -> TrackedRover:
    """Return the rover that a line means: the named, the selected or the only one. Raises CommandError."""
    wanted = selected if named is None else named
    if wanted is not None:
        if wanted not in rovers:
            heard = ", ".join(map(str, rovers)) or "none"
            raise CommandError(f"rover {wanted} is not heard (heard: {heard})")
        return rovers[wanted]
    if not rovers:
        raise CommandError("no rover is heard yet: is the link right, and does the companion run?")
    if len(rovers) > 1:
        first = next(iter(rovers))
        raise CommandError(f"rovers {', '.join(map(str, rovers))} are heard: write it as `rover {first} go`")
    return next(iter(rovers.values()))


def current_call(rover: TrackedRover) -> int:
    """Return the id that an answer without an id means; 0 when nothing is open."""
    if rover.current_id:
        return rover.current_id
    waiting = rover.open_calls()
    return waiting[-1].data.id if waiting else 0


def picture_of(picture: FetchPicture, rover: TrackedRover) -> tuple[str, str]:
    """Return a picture's path on the rover and its file name here. Raises CommandError without a picture."""
    if picture.size == "ground":
        return FROM_ABOVE, f"rover{rover.system}-ground.png"
    number = picture.call_id or current_call(rover)
    if not number:
        raise CommandError("no call is open: name one, `picture 7`")
    call = rover.calls.get(number)
    if call is not None and call.open and not call.data.picture:
        raise CommandError(f"{number} has no picture: it is a fault, or `[pictures] keep` is 0 on the rover")
    size = f"-{picture.size}" if picture.size else ""
    return f"/calls/{number}{size}.jpg", f"rover{rover.system}-call{number}{size}.jpg"


def address(answer: Answer, rover: TrackedRover, now: float) -> Answer:
    """Address an answer, as it was typed, to a call of `rover`; target 0: words that belong to no call.

    Raises CommandError when no open call fits, or when the current call is too new to have been read.
    """
    if answer.refuses_match:  # it must arrive even if the open call closes meanwhile
        return replace(answer, target=0)
    target = answer.target or current_call(rover)
    call = rover.calls.get(target)
    if answer.target and call is not None and not call.open:
        raise CommandError(f"call {target} is closed already: type `calls` for what is open")
    if not answer.target and target and rover.reported_for(target, now) < READ_S:
        raise CommandError(f"{target} is new, so nothing was sent: read it, then type that again")
    if not target and answer.motion is not Motion.NONE:
        raise CommandError("no call is open, so nothing waits for this; words alone are taken: `bush: -1`")
    if target and call is None and (taps := taps_of(answer.changes)):
        raise CommandError(
            f"call {target} is not told in full yet: wait a moment, or use `{taps[0].word}: -1`"
        )
    return replace(placed(answer, call.data if call is not None else None), target=target)
