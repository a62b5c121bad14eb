"""Formats the STATUSTEXTs of calls and holds: what happened and what to do, in at most 50 bytes.

"C7" is call 7, "H9" hold 9; "go/stay/word" are the three answers: go, stay, or name the thing.
"""

from __future__ import annotations

import math

from companion.wire.call_figures import place_figures, thing_figures
from companion.wire.ids import MAX_TEXT, Kind, Outcome
from companion.wire.packing import shortened

_ANSWERS = "go/stay/word"
_TWO = "go/word"
_OUTCOMES = {
    Outcome.NONE: "over",
    Outcome.ANSWERED: "answered, thank you",
    Outcome.ACCEPTED: "accepted this once",
    Outcome.PASSED: "the thing has passed",
    Outcome.TAKEN_OVER: "taken over, not by us",
    Outcome.RECOVERED: "fault is gone",
    Outcome.SWITCHED_OFF: "companion switched off",
}

REASONS = {
    "unknown_scene": "new place",
    "unknown_object": "unknown thing",
    "blocked": "way blocked",
    "fault": "fault",
}


def fit(text: str) -> str:
    """Make `text` one line of at most 50 bytes; a longer one is cut behind a whole word and ends in "..."."""
    line = "".join(character if character.isprintable() else " " for character in text)
    return shortened(line.encode(errors="replace").decode(), MAX_TEXT)


def unremembered(text: str) -> str:
    """Say of what was applied that the journal could not be written: a restart forgets it."""
    return f"not remembered (disk?): {text}"


def name(kind: Kind, number: int) -> str:
    """Name a call or hold: "C7" or "H9"."""
    return f"{'C' if kind == Kind.CALL else 'H'}{number}"


def percent(share: float | None) -> str:
    """Format a share in [0, 1] as "38%"; None and NaN as "?%"."""
    if share is None or not math.isfinite(share):
        return "?%"
    return f"{min(1.0, max(0.0, share)):.0%}"


def unknown_object(call: int, share: float | None, limit: float | None, of: str, light: str = "") -> str:
    """Calls for a thing ahead that no word explains. share, limit, of, light: as for `thing_figures`."""
    short = f"C{call} {thing_figures(share, limit, '')}"
    return _asking(f"C{call} {thing_figures(share, limit, of, light)}", short)


def unknown_scene(
    call: int, similarity: float | None, needed: float | None, like: int | None, light: str = ""
) -> str:
    """Calls for a place unlike the known ones. similarity, needed, like, light: as for `place_figures`."""
    short = f"C{call} {place_figures(similarity, needed, None)}"
    return _asking(f"C{call} {place_figures(similarity, needed, like, light)}", short)


def unknown_both(call: int, share: float | None, limit: float | None) -> str:
    """Calls for a new place with an unknown thing in it. share, limit: as for `thing_figures`."""
    known = thing_figures(share, limit, "")
    return _asking(f"C{call} new place, {known}", f"C{call} new place, unknown thing")


def _asking(text: str, short: str) -> str:
    """Return what fits of a text, or of a short one, with the answers behind it where there is room."""
    forms = [f"{text}: {_ANSWERS}", f"{text}: {_TWO}", text, f"{short}: {_ANSWERS}", short]
    return next((form for form in forms if len(form.encode()) <= MAX_TEXT), fit(short))


def trial_call(call: int) -> str:
    """Announces a test call, which checks that calls reach the operator."""
    return fit(f"C{call} TEST call, nothing is wrong: {_ANSWERS}")


def still_unknown(call: int, share: float | None, limit: float | None) -> str:
    """Reports that the answer's words do not cover the thing. share, limit: as for `thing_figures`."""
    return fit(f"C{call} stays open: {thing_figures(share, limit, '')}")


def still_new(call: int, similarity: float | None, needed: float | None) -> str:
    """Reports that the answer does not cover the place. similarity, needed: as for `place_figures`."""
    return fit(f"C{call} stays open: {place_figures(similarity, needed, None)}")


def answered_waiting(kind: Kind, number: int) -> str:
    """Reports that the words are known now and the vehicle waits for a go."""
    return fit(f"{name(kind, number)} answered, holding: go when ready")


def waiting_for_view(kind: Kind, number: int) -> str:
    """Reports that a go was given and the vehicle waits for OK frames."""
    return fit(f"{name(kind, number)} go given: waiting for a clear view")


def blocked(number: int, drivable: float | None, kind: Kind = Kind.HOLD) -> str:
    """Reports that the ground ahead is known and not drivable. drivable: its drivable share in [0, 1]."""
    return fit(f"{name(kind, number)} blocked {percent(drivable)} drivable: waiting")


def blocked_by(number: int, word: str, kind: Kind = Kind.HOLD) -> str:
    """Reports a thing ahead that an operator named as not drivable."""
    return fit(f"{name(kind, number)} blocked by {word}: waiting")


def no_way(number: int, kind: Kind = Kind.HOLD) -> str:
    """Reports that enough of the ground ahead is drivable, but no corridor of the vehicle's width."""
    return fit(f"{name(kind, number)} blocked, no way through: waiting")


def no_room(text: str) -> str:
    """Say in the text of a call or hold, too, that it cannot be passed: what leaves room is driven round.

    Where both do not fit, the answers are left out, and then the last of the figures.
    """
    number, _, told = text.partition(" ")
    longer = ", ".join(part for part in (f"{number} no room".lstrip(), told) if part)
    unasked = longer.rsplit(": ", 1)[0]
    forms = (longer, unasked, unasked.rsplit(", ", 1)[0])
    return next((fit(form) for form in forms if len(form.encode(errors="replace")) <= MAX_TEXT), fit(longer))


def clear(kind: Kind, number: int) -> str:
    """Asks for a go: the reasons are gone and the vehicle is still held."""
    return fit(f"{name(kind, number)} clear now, go?")


def cannot_guide(kind: Kind, number: int, why: str) -> str:
    """Says that the vehicle stands since it could not be driven round something, whatever room there is."""
    return fit(f"{name(kind, number)} cannot drive round: {why}, go?")


def room(kind: Kind, number: int) -> str:
    """Asks for a go: the vehicle is still held, and would drive round what it sees."""
    return fit(f"{name(kind, number)} room beside it, go?")


def fault(number: int, what: str, kind: Kind = Kind.HOLD) -> str:
    """Reports a fault: the companion cannot judge. what: two or three words ("no fresh frame")."""
    return fit(f"{name(kind, number)} FAULT {what}")


def companion_fault(what: str) -> str:
    """Reports that the companion cannot judge or cannot hold, when no open call or hold reports it."""
    return fit(f"Companion FAULT: {what}")


def recovered(*, view: bool) -> str:
    """Reports that a fault is gone."""
    return "Companion sees again" if view else "Companion: the fault is over"


def closed(kind: Kind, number: int, outcome: Outcome) -> str:
    """Reports that a call or hold is closed."""
    return fit(f"{name(kind, number)} closed: {_OUTCOMES[outcome]}")


def holding(kind: Kind, number: int) -> str:
    """Reports that the autopilot has confirmed the hold."""
    return fit(f"{name(kind, number)} holding")


def circling(kind: Kind, number: int) -> str:
    """Reports a confirmed hold in which the autopilot drives back to a point before it stands."""
    return fit(f"{name(kind, number)} holding: circles back before it stands")


def hold_failed(kind: Kind, number: int) -> str:
    """Reports that the autopilot did not accept the hold. Severity ALERT."""
    return fit(f"{name(kind, number)} HOLD FAILED: STOP BY HAND")


def resumed(kind: Kind, number: int, mode: str) -> str:
    """Reports that the mode from before the hold is in force again. A loiter item begins anew with it."""
    return fit(f"{name(kind, number)} resumed {mode}")


def resume_failed(kind: Kind, number: int) -> str:
    """Reports that the autopilot did not accept the mode from before the hold. Severity ALERT."""
    return fit(f"{name(kind, number)} RESUME FAILED: set the mode by hand")


def mission_over(kind: Kind, number: int, mode: str) -> str:
    """Refuses a resume, since the mission is over and would begin anew. mode: a human may set it."""
    return fit(f"{name(kind, number)} mission over, no resume: {mode} by hand")


def not_held(call: int) -> str:
    """Reports that a rover that stands after its mission is not held for this call."""
    return fit(f"C{call} mission complete: rover stands, not held")


def mission_moved(kind: Kind, number: int, item: int) -> str:
    """Reports that the mission's current item was changed during the hold, and which one it is now."""
    return fit(f"{name(kind, number)} goes on with item {item}, set in the hold")


def mission_replaced(kind: Kind, number: int, item: int) -> str:
    """Reports that there is another mission than before the hold. item: its current one."""
    return fit(f"{name(kind, number)} goes on with a new mission, item {item}")


def send_target_again() -> str:
    """Asks for a new target, because GUIDED lost its own in HOLD."""
    return "GUIDED lost its target: send the target again"


def stale(number: int) -> str:
    """Refuses an answer to an id that is not open. number: 0 for the current one, when none is open."""
    if not number:
        return "No call or hold is open: nothing changed"
    return fit(f"No open call or hold {number}: nothing changed")


def just_announced(kind: Kind, number: int) -> str:
    """Refuses an answer to "the current one" that came too soon after its announcement to be meant for it."""
    return fit(f"{name(kind, number)} is new: read it, then answer")


def not_shown(kind: Kind, number: int) -> str:
    """Refuses a tap in a video that did not show the frame of what is open, or not for long enough."""
    return fit(f"{name(kind, number)} not in the video yet: look, then tap")


def needs_no_tap(kind: Kind, number: int) -> str:
    """Refuses a tap where words are known already, or the reasons are gone."""
    return fit(f"{name(kind, number)} needs no tap: go or stay")


def dropped(kind: Kind, number: int) -> str:
    """Reports that the companion may not command any more, and leaves the vehicle as it is."""
    return fit(f"{name(kind, number)} let go: drive on by hand")


def frame_lost(call: int) -> str:
    """Reports that the call's picture was lost in a restart, and the newest one takes its place."""
    return fit(f"C{call} picture lost: it shows the newest now")


def go_lapsed(kind: Kind, number: int) -> str:
    """Reports that a go expired while it waited for OK frames."""
    return fit(f"{name(kind, number)} go has lapsed: send it again")


def go_taken_back(kind: Kind, number: int) -> str:
    """Reports that a later answer revoked a go."""
    return fit(f"{name(kind, number)} go taken back by a later answer")


def rebooted_into(kind: Kind, number: int, mode: str) -> str:
    """Reports a hold since the autopilot rebooted and drove by itself. mode: the one that it drove in."""
    return fit(f"{name(kind, number)} autopilot rebooted into {mode}: needs a go")


def taken_over(kind: Kind, number: int, mode: str) -> str:
    """Reports that a person changed the mode during our hold."""
    return fit(f"{name(kind, number)} taken over by hand: {mode}")


def _limits(seconds: float | None, metres: float | None) -> str:
    known = [(value, unit) for value, unit in ((seconds, "s"), (metres, "m")) if value is not None]
    return " or ".join(f"{math.ceil(value)} {unit}" for value, unit in known if math.isfinite(value)) or "?"


def fault_accepted(kind: Kind, number: int, what: str, seconds: float | None, metres: float | None) -> str:
    """Reports that a human drives on in spite of a fault, and for how long. what: two or three words."""
    return fit(f"{name(kind, number)} driven on for {_limits(seconds, metres)}: {what}")


def fault_not_accepted(kind: Kind, number: int) -> str:
    """Refuses to drive on in spite of a fault, since a human did so too often of late."""
    return fit(f"{name(kind, number)} accepted too often: drive in MANUAL")


def fault_acceptance_ends(seconds: float | None, metres: float | None, what: str) -> str:
    """Reports that the vehicle is held again soon, since the fault still stands."""
    return fit(f"Holds again in {_limits(seconds, metres)}: {what}")


def overrode(kind: Kind, number: int, mode: str) -> str:
    """Reports that our late command replaced a person's mode, and that it is held. Severity ALERT."""
    return fit(f"{name(kind, number)} our {mode} came after yours: HELD")


def taken_from_us(kind: Kind, number: int, mode: str) -> str:
    """Reports a mode, during our hold, that the autopilot may have entered by itself, as at a fence."""
    return fit(f"{name(kind, number)} taken over: {mode}, not by us")


def rebooted(kind: Kind, number: int) -> str:
    """Reports that the autopilot rebooted during our hold, which stays open."""
    return fit(f"{name(kind, number)} stays open: the autopilot rebooted")
