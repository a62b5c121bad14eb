"""Words answers: those from here, and those of others. For calls see `companion.browser.wording`."""

from __future__ import annotations

from companion.wire.answers import ForgetCall, ForgetWord, NewEpisode, Operation, OtherPlace, SetWord, TapBox
from companion.wire.documents import GivenAnswer
from companion.wire.ids import Motion
from companion.wire.packing import clean
from gcs_plugin.client.delivery import Pending, Status
from gcs_plugin.terminal.output import STATUS_TEXTS
from gcs_plugin.terminal.wording import result

_MOTIONS = {Motion.GO: "go", Motion.STAY: "stay", Motion.LOOK_AGAIN: "look again"}


def answer(motion: Motion, operations: tuple[Operation, ...]) -> str:
    """Word an answer that was sent from here."""
    return ", ".join([*map(_operation, operations), *([_MOTIONS[motion]] if motion in _MOTIONS else [])])


def status(pending: Pending) -> str:
    """Say what became of an answer that was sent from here."""
    ack = pending.acknowledgement
    if ack is not None and pending.status is Status.ACKNOWLEDGED:
        return result(ack)
    return STATUS_TEXTS[pending.status]


def _operation(operation: Operation) -> str:
    match operation:
        case SetWord(word, weight) | TapBox(_, _, word, weight):
            return f"{word}: {weight:g}"
        case ForgetWord(word):
            return f"forget {word}"
        case ForgetCall(number):
            return f"forget call {number}"
        case NewEpisode():
            return "new episode"
        case OtherPlace():
            return "another place"


def first_answer(given: GivenAnswer, own: tuple[int, int] | None) -> str:
    """Say who answered before this console. own: this console's ids."""
    who = "Another ground station"
    if given.sender is not None:
        who = f"Ground station {given.sender[0]}/{given.sender[1]}"
        if given.sender == own:
            who = f"Another program with this console's ids {own[0]}/{own[1]}"
    motion = "" if given.motion in ("none", "") else given.motion.replace("_", " ")
    said = ", ".join(part for part in (*given.operations, motion) if part)
    return clean(f"{who} answered first: {said or 'nothing'}")
