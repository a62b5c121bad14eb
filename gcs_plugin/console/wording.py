"""Words a call for somebody who sees one for the first time: why, what is meant, what to do."""

from __future__ import annotations

from companion.wire.answers import ForgetCall, ForgetWord, NewEpisode, Operation, OtherPlace, SetWord, TapBox
from companion.wire.ids import Kind, Motion, Reasons, Stage
from companion.wire.payloads import CallData
from companion.wire.texts import percent
from gcs_plugin.client.delivery import Pending, Status
from gcs_plugin.client.documents import GivenAnswer, NearestScene
from gcs_plugin.terminal.output import STATUS_TEXTS
from gcs_plugin.terminal.wording import clean, result, where

_MOTIONS = {Motion.GO: "go", Motion.STAY: "stay", Motion.LOOK_AGAIN: "look again"}


def reason(call: CallData) -> str:
    """Say in a sentence why the rover calls."""
    if call.test:
        return "This is a test: nothing is wrong."
    reasons = call.reasons
    there = f" {where(call.worst_tile_box)}" if call.worst_tile_box else ""
    if reasons & Reasons.UNKNOWN_OBJECT and reasons & Reasons.UNKNOWN_SCENE:
        return f"A new place, and something{there} that none of its words explains."
    if reasons & Reasons.UNKNOWN_OBJECT:
        return f"Something{there} that none of its words explains."
    if reasons & Reasons.UNKNOWN_SCENE:
        return "A place unlike those that it was told about."
    if reasons & Reasons.FAULT:
        return "It has no picture that it can judge."
    if reasons & Reasons.BLOCKED:
        named = f" The thing{there} was named as not drivable." if call.worst_tile_box else ""
        return f"The way ahead is known, and not drivable.{named}"
    return "What it called for is gone."


def points(call: CallData) -> bool:
    """Whether the call is about the thing in its yellow frame. One for a new place is about all of it."""
    if call.reasons & Reasons.UNKNOWN_SCENE and not call.reasons & Reasons.UNKNOWN_OBJECT:
        return False
    return call.worst_tile_box is not None


def figures(call: CallData) -> str:
    """Give the figures behind the reason."""
    shown = []
    if call.roi_uncertainty is not None:
        shown.append(f"{percent(call.roi_uncertainty)} of the region of interest unexplained")
    if call.worst_tile is not None and points(call):
        shown.append(f"{percent(call.worst_tile)} in the yellow frame")
    if call.drivable_share is not None:
        shown.append(f"{percent(call.drivable_share)} of the known ground drivable")
    if call.similarity is not None:
        shown.append(f"{call.similarity:.2f} like the place it knows")
    return ", ".join(shown)


def what_to_do(call: CallData) -> str:
    """Say what an operator should do now."""
    if call.stage is Stage.CLOSED:
        return ""
    if call.test:
        return "Answer go or stay: that shows that the way to you and back works."
    if call.stage is Stage.CLEAR:
        return "The reason is gone. Go?"
    if call.stage is Stage.ANSWERED:
        return "Answered. It waits until the way is clear; go lets it drive on then."
    if call.kind is Kind.HOLD:
        return "It waits until the way is clear. Go lets it drive on then."
    if call.reasons & Reasons.UNKNOWN_OBJECT:
        return "What is in the yellow frame? Name it, or say go if it may be driven over this once."
    if call.reasons & Reasons.UNKNOWN_SCENE:
        return "What is the ground here? Name it, or say go if all of it may be driven on this once."
    return "Go lets it drive on, stay ends the alarm."


def stands(call: CallData) -> str:
    """Say what the vehicle does because of the call."""
    if call.stage is Stage.CLOSED:
        return ""
    return "The vehicle is held." if call.holding else "The vehicle is not held by it."


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


def nearest(found: NearestScene, said: str, motion: str, alike: float | None) -> str:
    """Say which answered scene a call's is most like, and what the answer was.

    said: who answered, for a person. motion: of that answer, "" where it is not known. alike: the similarity
    from which two scenes count as one.
    """
    words = ", ".join(f"{word} {weight:g}" for word, weight in found.words.items())
    answer_ = ", ".join(filter(None, (words, motion))) or "go"
    where_ = f"call C{found.call_id}" if found.call_id else "a place that another rover learnt"
    far = alike is not None and found.similarity < alike
    most = "Not much like any place that was answered; nearest is" if far else "Most like"
    return clean(f"{most} {where_} ({found.similarity:.2f}): {said} {answer_}.")


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
