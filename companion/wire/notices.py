"""STATUSTEXT texts of the companion's own affairs, at most 50 bytes: policy, words, senders, disk, errors."""

from __future__ import annotations

import math
from collections.abc import Iterable

from companion.wire.ids import COMPONENT_ID, Policy
from companion.wire.texts import REASONS, fit


def _seconds(value: float | None) -> str:
    return "? s" if value is None or not math.isfinite(value) else f"{min(99.9, max(0.0, value)):.1f} s"


def _fast(speed: float | None) -> str:
    """Rounded down: what is said to fit must fit."""
    if speed is None or not math.isfinite(speed):
        return "?"
    return f"{math.floor(10 * min(99.9, max(0.0, speed)) + 1e-6) / 10:.1f}"


def trial_answered(number: int, system: int, component: int, seconds: float | None) -> str:
    """A test call's way to the ground and back."""
    return fit(f"C{number} TEST answered by {system}/{component} after {_seconds(seconds)}")


def trial_unanswered(number: int) -> str:
    """Nobody answered the test call in time."""
    return fit(f"C{number} TEST over: nobody answered")


def trial_cut_short(number: int) -> str:
    """A real call or hold came while the test call was open."""
    return fit(f"C{number} TEST over: a real call came")


def would_hold(number: int, reasons: Iterable[str]) -> str:
    """Shadow policy: what the hold policy would have held now, the `number`-th."""
    named = [REASONS[reason] for reason in reasons]
    more = f" +{len(named) - 2}" if len(named) > 2 else ""
    return fit(f"S{number} would hold: {', '.join(named[:2])}{more}")


def shadow_so_far(count: int, hours: float, most: str) -> str:
    """Shadow policy, summed up. most: the reason of the most."""
    rate = f" ({count / hours:.1f}/h)" if count and hours >= 0.1 else ""
    named = f", most {REASONS.get(most, most)}" if most else ""
    return fit(f"Shadow: {count} in {hours:.1f} h{rate}{named}")


def unknown_autopilot() -> str:
    """Neither ArduPilot Rover nor a PX4 rover."""
    return "Autopilot of unknown kind: it is never held"


def autopilot_back() -> str:
    """Its heartbeat is heard again."""
    return "Autopilot is heard again"


def script_holds(why: str, mode: str) -> str:
    """The script on the autopilot holds the vehicle, for `why`; `mode` set by a human ends that."""
    return fit(f"Script holds ({why}): set {mode} by hand")


def ids_taken(system: int, connection: str) -> str:
    """Another component speaks under our ids on this connection: nothing more is said there."""
    return fit(f"Another {system}/{COMPONENT_ID} on link {connection}: silent there")


def off(by: str = "") -> str:
    """Nobody watches the trail. by: who switched off, "RC7" or "255/190"."""
    return fit(f"Companion OFF{f' by {by}' if by else ''}: nobody watches the trail")


def policy(value: Policy, by: str) -> str:
    """What the companion may do, after `by` changed it."""
    return fit(f"Companion policy: {value.name.lower()} (by {by})")


def switch_wins(switch: str) -> str:
    """A command wants to switch on, and the remote control says off."""
    return fit(f"Refused: {switch} says off, switch it on there")


def still_off(switch: str, by: str) -> str:
    """The remote control says on, and a command has said off."""
    return fit(f"{switch} is on, {by} said off: set AT_POLICY")


def switch_lost(switch: str, *, off: bool) -> str:
    """The off switch is not heard: its last position stands."""
    return fit(f"Off switch {switch} not heard: stays {'OFF' if off else 'on'}")


def switch_heard(switch: str, *, off: bool) -> str:
    """The off switch is heard again."""
    return fit(f"Off switch {switch} heard: {'OFF' if off else 'on'}")


def hold_refused(seconds: float | None) -> str:
    """The perceiver is too slow for policy hold. seconds: what it takes for a frame."""
    return fit(f"HOLD refused: {_seconds(seconds)} a frame is too slow")


def only_reports(seconds: float | None) -> str:
    """The owner configured policy hold, and the perceiver is too slow for it."""
    return fit(f"Only reports: {_seconds(seconds)} a frame, slow for HOLD")


def outruns(speed: float | None, fits: float | None) -> str:
    """The vehicle does not stop before what its camera shows. Both in m/s; fits: what would do."""
    return f"{_fast(speed)} m/s outruns eyes, {_fast(fits)} fits"


def hold_outruns(speed: float | None, fits: float | None) -> str:
    """Policy hold is refused for it."""
    return fit(f"HOLD refused: {outruns(speed, fits)}")


def only_reports_outrunning(speed: float | None, fits: float | None) -> str:
    """The owner configured policy hold, and the vehicle is too fast for it."""
    return fit(f"Only reports: {outruns(speed, fits)}")


def hold_unchecked() -> str:
    """Policy hold is refused: the figures that say whether the vehicle stops in time are missing."""
    return "HOLD refused: set [mount] and [stopping]"


def only_reports_unchecked() -> str:
    """The owner configured policy hold, and those figures are missing."""
    return "Only reports: set [mount] and [stopping]"


def hold_fits() -> str:
    """What refused policy hold is gone, by other settings: nobody sets it but the operator."""
    return "HOLD fits again: set AT_POLICY 2"


def stopping_unchecked() -> str:
    """Policy hold without the figures that say whether the vehicle stops in time, as its owner wants it."""
    return "Stopping not checked: set [mount] and [stopping]"


def int8_idle() -> str:
    """The bundle carries an int8 variant, and fp32 runs."""
    return "Runs fp32, not the bundle's int8: log says why"


def known_place(call: int) -> str:
    """A remembered scene gave its words. call: the answered one, 0 for the first scene."""
    return fit(f"Known place again: words of C{call}" if call else "Known place again: words as at first")


def vision_unreliable(*, hold: bool) -> str:
    """The vision process dies again and again."""
    return fit(f"Vision died 3 times in 10 min: {'a go is needed' if hold else 'see its log'}")


def unexpected_error() -> str:
    """An error that nobody foresaw; the companion goes on."""
    return "Companion error: see its log"


def dying() -> str:
    """An error that the companion cannot survive: severity ALERT."""
    return "Companion STOPS, internal error: WATCH THE TRAIL"


def journal_fails() -> str:
    """Answers are taken, but a restart forgets them."""
    return "Journal cannot be written, disk? Not remembered"


def journal_works() -> str:
    """The journal could be written again."""
    return "Journal is written again"


def word_dropped(word: str) -> str:
    """Too many words in use: the least recently set one went."""
    return fit(f"Too many words, out of use: {word}")


def out_of_use(word: str) -> str:
    """A word, or several, that a remembered scene put out of use."""
    return fit(f"Out of use here: {word}")


def weak_word(word: str) -> str:
    """A word came into use that the perceiver finds badly."""
    return fit(f"Weak word, better to tap: {word}")


def sender_refused(system: int) -> str:
    """A sender that may not change anything."""
    return fit(f"Sender {system} refused: not in allowed_senders")


def value_refused(parameter: str, allowed: str) -> str:
    """A parameter's value out of range; `allowed` is its range."""
    return fit(f"{parameter} takes {allowed}: kept")


def read_only(parameter: str) -> str:
    """A parameter that cannot be set."""
    return fit(f"{parameter} is read-only: kept")


def kept_for_hold(parameter: str, reason: str) -> str:
    """A value under which the vehicle could not be held any more. reason: as of `outruns`."""
    return fit(f"{parameter} kept: {reason}")


def answer_refused() -> str:
    """A value of AT_ANSWER that says nothing."""
    return "AT_ANSWER: id x 10 + 1 go, 2 stay, 3 look again"


def other_version() -> str:
    """The ground speaks another version of the payloads."""
    return "Ground plug-in of another version: update it"


def refused(reason: str) -> str:
    """Anything else that was not done."""
    return fit(f"Refused: {reason}")
