"""Words a call for somebody who sees one for the first time: why, what is meant, what to do."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

from companion.wire.call_figures import place_in_words, thing_in_words
from companion.wire.call_report import CallReport, GivenAnswer
from companion.wire.ids import PAGE_SENDER, Kind, Outcome, Reasons, Stage
from companion.wire.packing import clean, where
from companion.wire.texts import percent

OUTCOMES = {
    Outcome.NONE: "",
    Outcome.ANSWERED: "answered",
    Outcome.ACCEPTED: "accepted by a go",
    Outcome.PASSED: "passed by itself",
    Outcome.TAKEN_OVER: "taken over, not by the companion",
    Outcome.RECOVERED: "the fault is gone",
    Outcome.SWITCHED_OFF: "the companion was switched off",
}
"""How a call was closed, where only its record tells of it."""
_APPLIED = frozenset({"applied", "applied_not_remembered", "not_covered"})
_NO_MOTION = ("none", "")
_NAMED = re.compile(r"(?:tap )?([^:;]{1,48}): (-?[01](?:\.[0-9]{1,4})?)(?: .*)?")
_TAP = re.compile(r"tap ([^:]{1,64}: \S{1,8})(?: \S{1,8}){4}")
"""An answer that names what is in a box; a person sees the box in the picture."""


def reason(call: CallReport) -> str:
    """Say in one line why the rover calls, with the figures that it tells and what they lack."""
    if call.test:
        return "This is a test: nothing is wrong."
    reasons, box = call.reasons, call.worst_tile_box
    there = f" {where(box)}" if box else ""
    if reasons & Reasons.UNKNOWN_OBJECT:
        new = "New place, and unknown" if reasons & Reasons.UNKNOWN_SCENE else "Unknown"
        metres = "" if call.distance is None else f", {call.distance:.1f} m ahead"
        return _line(f"{new} thing{there}{metres}", thing_in_words(call.why) or _unknown(call))
    if reasons & Reasons.UNKNOWN_SCENE:
        return _line("New place", place_in_words(call.why))
    if reasons & Reasons.FAULT:
        return "It has no picture that it can judge."
    if reasons & Reasons.BLOCKED:
        named = f" The thing{there} was named as not drivable." if box else ""
        return f"The way ahead is known, and not drivable.{named}"
    return "What it called for is gone."


def _line(what: str, figures: str) -> str:
    return f"{what}: {figures}." if figures else f"{what}."


def _unknown(call: CallReport) -> str:
    """Tell the figures of a thing where the rover's own words for them did not come."""
    if call.stage is not Stage.OPEN:
        return ""  # by now they are those of the frame judged again
    if call.worst_tile is not None and call.worst_tile_box is not None:
        return f"{percent(call.worst_tile)} of the yellow frame is unknown".replace("%", " %")
    if call.roi_uncertainty is not None:
        return f"{percent(call.roi_uncertainty)} of the region is unknown".replace("%", " %")
    return ""


def points(call: CallReport) -> bool:
    """Whether the call is about the thing in its yellow frame. One for a new place is about all of it."""
    if call.reasons & Reasons.UNKNOWN_SCENE and not call.reasons & Reasons.UNKNOWN_OBJECT:
        return False
    return call.worst_tile_box is not None


def figures(call: CallReport) -> str:
    """Give further figures of the call's frame, which do not stand in the reason."""
    shown = []
    if not call.why and call.roi_uncertainty is not None:
        shown.append(f"{percent(call.roi_uncertainty)} of the region of interest unexplained")
    if call.drivable_share is not None:
        shown.append(f"{percent(call.drivable_share)} of the known ground drivable")
    if not call.why and call.similarity is not None:
        shown.append(f"{call.similarity:.2f} like the place it knows")
    return ", ".join(shown)


def what_to_do(call: CallReport) -> str:
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


def stands(call: CallReport) -> str:
    """Say what the vehicle does because of the call."""
    if call.stage is Stage.CLOSED:
        return ""
    return "The vehicle is held." if call.holding else "The vehicle is not held by it."


def newest_motion(motions: Sequence[str]) -> str:
    """Return the last of these that is a motion, for a person; "" where none is. motions: by name."""
    return next((one.replace("_", " ") for one in reversed(motions) if one not in _NO_MOTION), "")


def without_box(operation: str) -> str:
    """Leave out the box of a tap that is written as an operator types it: a person sees it in the picture."""
    return _TAP.sub(r"\1", operation)


def answered(given: GivenAnswer) -> str:
    """Word an answer in a call's record: what was answered, and what the rover said to it."""
    said = ", ".join(filter(None, (*map(without_box, given.operations), newest_motion([given.motion]))))
    return clean(": ".join(filter(None, (said, given.text))))


def first_answer(record: CallReport, own: tuple[int, int] | None) -> str:
    """Say who first gave an answer that changed something; "" where nobody did.

    own: MAVLink ids of the page's program, None where it has none.
    """
    given = next((one for one in record.answers if applied(one)), None)
    if given is None:
        return ""
    who = "Another ground station"
    if given.sender == PAGE_SENDER:
        who = "Somebody on the rover's own page"
    elif given.sender is not None:
        who = f"Ground station {given.sender[0]}/{given.sender[1]}"
        if given.sender == own:
            who = f"Another program with this console's ids {own[0]}/{own[1]}"
    said = ", ".join(filter(None, (*given.operations, newest_motion([given.motion]))))
    return clean(f"{who} answered first: {said or 'nothing'}")


def named(record: CallReport) -> dict[str, float]:
    """Return the words that answers to a call set or tapped, by weight."""
    return {word: weight for one in record.answers for word, weight in words_of(one).items()}


def words_of(given: GivenAnswer) -> dict[str, float]:
    """Return the words that an answer in a record set or tapped, by weight."""
    found = (_NAMED.fullmatch(clean(one)) for one in given.operations)
    return {one[1]: float(one[2]) for one in found if one}


def tapped(given: GivenAnswer) -> dict[str, float]:
    """Return the words that an answer in a record tapped, by weight."""
    taps = tuple(one for one in given.operations if _TAP.fullmatch(clean(one)))
    return words_of(replace(given, operations=taps))


def applied(given: GivenAnswer) -> bool:
    """Whether an answer in a record changed something."""
    return given.result in _APPLIED
