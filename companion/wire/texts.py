"""STATUSTEXT texts of calls and holds: what happened and what to do, in at most 50 bytes.

"C7" is call 7, "H9" hold 9; "go/stay/word" are the three answers: go, stay, or name the thing.
"""

from __future__ import annotations

import math

from companion.wire.ids import MAX_TEXT, Kind, Outcome
from companion.wire.packing import shortened

_ANSWERS = "go/stay/word"
_OUTCOMES = {
    Outcome.NONE: "over",
    Outcome.ANSWERED: "answered, thank you",
    Outcome.ACCEPTED: "accepted this once",
    Outcome.PASSED: "the thing has passed",
    Outcome.TAKEN_OVER: "a human took over",
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
    """One line of at most 50 bytes; what is longer ends behind a whole word, with "..."."""
    line = "".join(character if character.isprintable() else " " for character in text)
    return shortened(line.encode(errors="replace").decode(), MAX_TEXT)


def name(kind: Kind, number: int) -> str:
    """ "C7" or "H9"."""
    return f"{'C' if kind == Kind.CALL else 'H'}{number}"


def percent(share: float | None) -> str:
    """[0, 1] as "38%"; None and NaN as "?%"."""
    if share is None or not math.isfinite(share):
        return "?%"
    return f"{min(1.0, max(0.0, share)):.0%}"


def _similarity(value: float | None) -> str:
    return "" if value is None or not math.isfinite(value) else f" {min(1.0, max(-1.0, value)):.2f}"


def unknown_object(call: int, uncertainty: float | None) -> str:
    """A thing ahead that no word explains."""
    return fit(f"C{call} unknown thing ahead {percent(uncertainty)}: {_ANSWERS}")


def unknown_scene(call: int, similarity: float | None) -> str:
    """A place unlike the known ones."""
    return fit(f"C{call} new place{_similarity(similarity)}: {_ANSWERS}")


def unknown_both(call: int, uncertainty: float | None) -> str:
    """A new place and an unknown thing in it."""
    return fit(f"C{call} new place, unknown thing {percent(uncertainty)}: {_ANSWERS}")


def trial_call(call: int) -> str:
    """A call made to see whether the operator hears it."""
    return fit(f"C{call} TEST call, nothing is wrong: {_ANSWERS}")


def still_unknown(call: int, uncertainty: float | None) -> str:
    """The answer did not cover the thing."""
    return fit(f"C{call} stays open: still unknown {percent(uncertainty)}")


def still_new(call: int, similarity: float | None) -> str:
    """The answer did not cover the place."""
    return fit(f"C{call} stays open: still a new place{_similarity(similarity)}")


def answered_waiting(kind: Kind, number: int) -> str:
    """The words are known now; the vehicle waits."""
    return fit(f"{name(kind, number)} answered, holding: go when ready")


def waiting_for_view(kind: Kind, number: int) -> str:
    """A go was given; the vehicle waits until it sees a clear way."""
    return fit(f"{name(kind, number)} go given: waiting for a clear view")


def blocked(number: int, drivable: float | None, kind: Kind = Kind.HOLD) -> str:
    """The ground ahead is known and not drivable."""
    return fit(f"{name(kind, number)} blocked {percent(drivable)} drivable: waiting")


def blocked_by(number: int, word: str, kind: Kind = Kind.HOLD) -> str:
    """A thing stands ahead that an operator named as not drivable."""
    return fit(f"{name(kind, number)} blocked by {word}: waiting")


def no_way(number: int, kind: Kind = Kind.HOLD) -> str:
    """Enough of the ground ahead is drivable, but the vehicle does not fit through."""
    return fit(f"{name(kind, number)} blocked, no way through: waiting")


def clear(kind: Kind, number: int) -> str:
    """The reasons are gone and the vehicle still stands."""
    return fit(f"{name(kind, number)} clear now, go?")


def fault(number: int, what: str, kind: Kind = Kind.HOLD) -> str:
    """The companion cannot judge: `what` in two or three words ("no fresh frame")."""
    return fit(f"{name(kind, number)} FAULT {what}")


def companion_fault(what: str) -> str:
    """The companion cannot judge or cannot hold, and nothing is open that says so."""
    return fit(f"Companion FAULT: {what}")


def recovered() -> str:
    """The fault is gone."""
    return "Companion sees again"


def closed(kind: Kind, number: int, outcome: Outcome) -> str:
    """A call or hold is over."""
    return fit(f"{name(kind, number)} closed: {_OUTCOMES[outcome]}")


def holding(kind: Kind, number: int) -> str:
    """The autopilot has confirmed the hold."""
    return fit(f"{name(kind, number)} holding")


def circling(kind: Kind, number: int) -> str:
    """The autopilot has confirmed the hold, and turns back to the point before it stands."""
    return fit(f"{name(kind, number)} holding: circles back before it stands")


def hold_failed(kind: Kind, number: int) -> str:
    """The autopilot did not take the hold: severity ALERT."""
    return fit(f"{name(kind, number)} HOLD FAILED: STOP BY HAND")


def resumed(kind: Kind, number: int, mode: str) -> str:
    """The mode before the hold is back."""
    return fit(f"{name(kind, number)} resumed {mode}")


def resume_failed(kind: Kind, number: int) -> str:
    """The autopilot did not take the mode back: severity ALERT."""
    return fit(f"{name(kind, number)} RESUME FAILED: set the mode by hand")


def send_target_again() -> str:
    """GUIDED lost its target in HOLD."""
    return "GUIDED lost its target: send the target again"


def stale(number: int) -> str:
    """An answer to an id that is not open; 0: to the current one, and there is none."""
    if not number:
        return "No call or hold is open: nothing changed"
    return fit(f"No open call or hold {number}: nothing changed")


def just_announced(kind: Kind, number: int) -> str:
    """An answer to "the current one" that came too soon after it was announced to be meant for it."""
    return fit(f"{name(kind, number)} is new: read it, then answer")


def dropped(kind: Kind, number: int) -> str:
    """The companion may not command any more: the vehicle stays as it is."""
    return fit(f"{name(kind, number)} let go: drive on by hand")


def frame_lost(call: int) -> str:
    """After a restart the call's picture is not there: the newest one takes its place."""
    return fit(f"C{call} picture lost: it shows the newest now")


def go_lapsed(kind: Kind, number: int) -> str:
    """A go waited too long for a clear view."""
    return fit(f"{name(kind, number)} go is too old: send it again")


def go_taken_back(kind: Kind, number: int) -> str:
    """A later answer than the go says something else."""
    return fit(f"{name(kind, number)} go taken back by a later answer")


def taken_over(kind: Kind, number: int, mode: str) -> str:
    """A human changed the mode during our hold."""
    return fit(f"{name(kind, number)} taken over by hand: {mode}")


def rebooted(kind: Kind, number: int) -> str:
    """The autopilot rebooted during our hold: nobody took over."""
    return fit(f"{name(kind, number)} stays open: the autopilot rebooted")
