"""Formats STATUSTEXTs about the companion itself, at most 50 bytes: policy, words, senders, disk, errors."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping

from anytraverse.preferences import turns_sign
from companion.wire.ids import COMPONENT_ID, MAX_TEXT, PAGE_SENDER, Policy, SenderId
from companion.wire.packing import shortened
from companion.wire.texts import REASONS, fit, unremembered


def _seconds(value: float | None) -> str:
    return "? s" if value is None or not math.isfinite(value) else f"{min(99.9, max(0.0, value)):.1f} s"


def _fast(speed: float | None) -> str:
    """Format a speed in m/s, rounded down: a speed that is reported as slow enough must be slow enough."""
    if speed is None or not math.isfinite(speed):
        return "?"
    return f"{math.floor(10 * min(99.9, max(0.0, speed)) + 1e-6) / 10:.1f}"


def trial_answered(number: int, system: int, component: int, seconds: float | None) -> str:
    """Reports who answered the test call, and the s from sending it to the answer."""
    return fit(f"C{number} TEST answered by {system}/{component} after {_seconds(seconds)}")


def trial_unanswered(number: int) -> str:
    """Reports that the test call was not answered in time."""
    return fit(f"C{number} TEST over: nobody answered")


def trial_cut_short(number: int) -> str:
    """Reports that a real call or hold ended the test call."""
    return fit(f"C{number} TEST over: a real call came")


def would_hold(number: int, reasons: Iterable[str]) -> str:
    """Reports, in shadow policy, the `number`-th hold that the hold policy would have made now."""
    named = [REASONS[reason] for reason in reasons]
    more = f" +{len(named) - 2}" if len(named) > 2 else ""
    return fit(f"S{number} would hold: {', '.join(named[:2])}{more}")


def shadow_so_far(count: int, hours: float, most: str) -> str:
    """Sums up shadow policy: would-be holds and hours. most: the most frequent reason."""
    rate = f" ({count / hours:.1f}/h)" if count and hours >= 0.1 else ""
    named = f", most {REASONS.get(most, most)}" if most else ""
    return fit(f"Shadow: {count} in {hours:.1f} h{rate}{named}")


def camera_id_taken(component: int) -> str:
    """Reports another camera under our camera's component id, which is silent because of it."""
    return fit(f"Another camera is {component}: set [video] component")


def unknown_autopilot() -> str:
    """Reports an autopilot that is neither ArduPilot Rover nor a PX4 rover."""
    return "Autopilot of unknown kind: it is never held"


def autopilot_back() -> str:
    """Reports that the autopilot's heartbeat is received again."""
    return "Autopilot is heard again"


def dead_man_refused(whom: str) -> str:
    """Reports that PX4 is not guarded by our stream of sticks. whom: who steers, too, "255/190"."""
    return fit(f"Dead man OFF, sticks of {whom}: guard by hand")


def dead_man_ends() -> str:
    """Reports that our stream of sticks ends while PX4 drives by itself, which makes it hold."""
    return "Dead man ends: PX4 holds, set MISSION by hand"


def script_holds(why: str, mode: str) -> str:
    """Reports that the autopilot's script holds the vehicle. mode: ends the hold when set by a person."""
    return fit(f"Script holds ({why}): set {mode} by hand")


def ids_taken(system: int, connection: str) -> str:
    """Reports that another component uses our ids on this connection, so only holds are sent there."""
    return fit(f"Another {system}/{COMPONENT_ID} on link {connection}: silent there")


def off(by: str = "") -> str:
    """Reports that the companion is off. by: who switched it off, "RC7" or "255/190"."""
    return fit(f"Companion OFF{f' by {by}' if by else ''}: nobody watches the trail")


def policy(value: Policy, by: str) -> str:
    """Reports the policy after `by` changed it."""
    return fit(f"Companion policy: {value.name.lower()} (by {by})")


def switch_wins(switch: str) -> str:
    """Refuses to switch on by command while the remote control's switch says off."""
    return fit(f"Refused: {switch} says off, switch it on there")


def still_off(switch: str, by: str) -> str:
    """Reports that the companion stays off: the switch says on, but a command switched off."""
    return fit(f"{switch} is on, {by} said off: set AT_POLICY")


def switch_lost(switch: str, *, off: bool) -> str:
    """Reports that the off switch's channel is not received; its last position stays in force."""
    return fit(f"Off switch {switch} not heard: stays {'OFF' if off else 'on'}")


def switch_heard(switch: str, *, off: bool) -> str:
    """Reports that the off switch's channel is received again."""
    return fit(f"Off switch {switch} heard: {'OFF' if off else 'on'}")


def hold_refused(seconds: float | None) -> str:
    """Refuses policy hold, because the perceiver is too slow. seconds: its time for a frame."""
    return fit(f"HOLD refused: {_seconds(seconds)} a frame: make it faster")


def fault_slow(seconds: float | None) -> str:
    """Reports the fault that policy hold is in force and the perceiver is too slow for it."""
    return fit(f"FAULT: {_seconds(seconds)} a frame: faster, or AT_POLICY 0")


def guide_slow(rate: float | None) -> str:
    """Refuses policy guide, because too few pictures are judged. rate: a second."""
    return fit(f"GUIDE refused: judges {_fast(rate)}/s: too few")


def fault_guide_slow(rate: float | None) -> str:
    """Reports the fault that policy guide is in force and too few pictures are judged for it."""
    return fit(f"FAULT: judges {_fast(rate)}/s: faster, or AT_POLICY 2")


def outruns(speed: float | None, fits: float | None) -> str:
    """Says that the vehicle cannot stop within what its camera shows. m/s; fits: speed at which it can."""
    return f"{_fast(speed)} m/s outruns eyes, {_fast(fits)} fits"


def hold_outruns(speed: float | None, fits: float | None) -> str:
    """Refuses policy hold, because the vehicle is too fast."""
    return fit(f"HOLD refused: {_fast(speed)} m/s outruns eyes: at most {_fast(fits)}")


def fault_outruns(speed: float | None, fits: float | None) -> str:
    """Reports the fault that policy hold is in force and the vehicle is too fast for it."""
    return fit(f"FAULT: {_fast(speed)} m/s: at most {_fast(fits)}, or AT_POLICY 0")


def hold_unchecked() -> str:
    """Refuses policy hold, because the figures for the stopping distance are missing."""
    return "HOLD refused: set [mount] and [stopping]"


def fault_unchecked() -> str:
    """Reports the fault that policy hold is in force and those figures are missing."""
    return "FAULT: set [mount], [stopping], or AT_POLICY 0"


def hold_infrared() -> str:
    """Refuses policy hold, because the camera shows infrared and the perceiver is not trained for that."""
    return "HOLD refused: NoIR camera: change it"


def fault_infrared() -> str:
    """Reports the fault that policy hold is in force and the camera shows infrared."""
    return "FAULT: NoIR camera: change it, or AT_POLICY 0"


def fault_region(misfit: str) -> str:
    """Reports that the vehicle does not fit into the region of interest. misfit: why, and what to do."""
    return fit(f"FAULT: {misfit}")


def manual_may_need() -> str:
    """Says what arming in MANUAL needs in a fault, since the autopilot's script may demand a companion."""
    return "To arm for MANUAL in a FAULT: ATS_NEED 0"


def infrared(*, handled: bool) -> str:
    """Reports that the camera shows infrared. handled: whether the vehicle may be held all the same."""
    return f"Camera shows infrared (NoIR): {'handled' if handled else 'change it for HOLD'}"


def infrared_over() -> str:
    """Reports that the camera does not show infrared any more."""
    return "Camera shows no infrared any more"


def guide_lacks(setting: str) -> str:
    """Refuses policy guide, because a setting that it needs is missing."""
    return fit(f"GUIDE refused: set {setting}")


def guiding() -> str:
    """Reports that the companion drives round something."""
    return "GUIDE: driving round it, in GUIDED"


def guided_back(mode: str) -> str:
    """Reports that the mission has the vehicle again."""
    return fit(f"GUIDE: past it, back in {mode}")


def guide_ended(why: str) -> str:
    """Reports that guiding ended otherwise."""
    return fit(f"GUIDE ended: {why}")


def hold_fits() -> str:
    """Reports that settings now allow policy hold. Only the operator sets it again."""
    return "HOLD fits again: set AT_POLICY 2"


def stopping_unchecked() -> str:
    """Warns that policy hold is in force without a check of the stopping distance, as configured."""
    return "Stopping not checked: set [mount] and [stopping]"


def int8_idle() -> str:
    """Reports that fp32 runs, although the bundle has an int8 variant."""
    return "Runs fp32, not the bundle's int8: log says why"


def judging_rate(rate: float, configured: float, why: str) -> str:
    """Reports the new rate of judging, frames/s. why: what lowered it, "" where it rose."""
    of = "" if rate == configured else f" of {configured:.3g}"
    return fit(f"Judges {rate:.3g}/s{of}: {why}" if why else f"Judges {rate:.3g}/s{of} again")


def no_lower_rate(why: str) -> str:
    """Reports that the computer stays hot or throttled at the lowest rate of judging. why: which of them."""
    return fit(f"{why.capitalize()}: cannot judge less, cool it")


def known_place(call: int, similarity: float | None) -> str:
    """Reports that the words of a remembered scene are in force. call: its call, 0 without one.

    Without one are the first scene, and those that were imported from another rover.
    similarity: cosine of the frame to it, rounded down: one that is reported as 1 must be 1.
    """
    whose = f"C{call}" if call else "that place"
    if similarity is None or not math.isfinite(similarity):
        return fit(f"Known place again: words of {whose}")
    shown = math.floor(100 * min(1.0, max(-1.0, similarity)) + 1e-4) / 100
    return fit(f"Known place again: words of {whose} ({shown:.2f})")


_WORD_LINES = 3


def matched_words(call: int, before: Mapping[str, float], after: Mapping[str, float]) -> list[str]:
    """Reports which words a remembered scene changed: "C12: gravel 1, bush -1 (was -0.5)"; at most 3 texts.

    Words whose sign it turned come first. Words that it put out of use are reported by `out_of_use`.
    call: 0 without one.
    """
    turned_first = sorted(after.items(), key=lambda one: not turns_sign(before.get(one[0], one[1]), one[1]))
    changed = [
        f"{word} {weight:g}{f' (was {before[word]:g})' if word in before else ''}"
        for word, weight in turned_first
        if before.get(word) != weight
    ]
    head, lines = f"C{call}: " if call else "There: ", list[list[str]]()
    for word in changed:
        if lines and len((head + ", ".join([*lines[-1], word])).encode()) <= MAX_TEXT:
            lines[-1].append(word)
        else:
            lines.append([word])
    texts = [fit(head + ", ".join(line)) for line in lines[:_WORD_LINES]]
    if left := sum(map(len, lines[_WORD_LINES:])):
        texts[-1] = f"{shortened(texts[-1], MAX_TEXT - 4)} +{left}"
    return texts


def vision_unreliable(*, hold: bool) -> str:
    """Reports that the vision process died three times in ten minutes. hold: a go is needed to drive on."""
    return fit(f"Vision died 3 times in 10 min: {'a go is needed' if hold else 'see its log'}")


def unexpected_error() -> str:
    """Reports an unexpected error; the companion goes on."""
    return "Companion error: see its log"


def dying() -> str:
    """Reports an error that ends the companion. Severity ALERT."""
    return "Companion STOPS, internal error: WATCH THE TRAIL"


def journal_fails() -> str:
    """Reports that the journal cannot be written: answers apply, but a restart loses them."""
    return "Journal cannot be written, disk? Not remembered"


def not_remembered(what: str) -> str:
    """Reports a policy or parameter that is in force, and which a restart forgets."""
    return fit(unremembered(what))


def journal_works() -> str:
    """Reports that the journal can be written again."""
    return "Journal is written again"


def timestamps_fail() -> str:
    """Reports that signing timestamps cannot be written: after a kill, old frames could be replayed."""
    return "Signing times cannot be written: check the disk"


def timestamps_work() -> str:
    """Reports that signing timestamps can be written again."""
    return "Signing times are written again"


def word_dropped(word: str) -> str:
    """Reports that `word`, the least recently set one, is out of use, because there were too many."""
    return fit(f"Too many words, out of use: {word}")


MOST_TURNED = 6
"""Texts about turned signs; at most eight texts wait on the link."""


def words_turned(turned: Mapping[str, tuple[float, float]], sender: SenderId) -> list[str]:
    """Reports the words whose sign `sender` turned: "water turned: -1 to +1, by 255/190"; at most 6 texts.

    turned: weight before and after, by word.
    """
    by = "page" if sender == PAGE_SENDER else f"{sender[0]}/{sender[1]}"
    texts = []
    for word, (was, now) in list(turned.items())[:MOST_TURNED]:
        rest = f" turned: {was:+.3g} to {now:+.3g}, by {by}"
        texts.append(fit(shortened(word, MAX_TEXT - len(rest)) + rest))
    if left := len(turned) - len(texts):
        texts[-1] = f"{left + 1} more words turned, by {by}"
    return texts


def out_of_use(word: str) -> str:
    """Reports one or more words that a remembered scene put out of use."""
    return fit(f"Out of use here: {word}")


def weak_word(word: str) -> str:
    """Warns that the perceiver detects a newly set word poorly."""
    return fit(f"Weak word, better to tap: {word}")


def sender_refused(system: int) -> str:
    """Refuses a sender that may not change anything."""
    return fit(f"Sender {system} refused: not in allowed_senders")


def value_refused(parameter: str, allowed: str) -> str:
    """Refuses a parameter's value that is out of range; `allowed` is the range."""
    return fit(f"{parameter} takes {allowed}: kept")


def read_only(parameter: str) -> str:
    """Refuses to set a read-only parameter."""
    return fit(f"{parameter} is read-only: kept")


def kept_for_hold(parameter: str, reason: str) -> str:
    """Refuses a value with which the vehicle would no longer stop in time. reason: from `outruns`, say."""
    return fit(f"{parameter} kept: {reason}")


def answer_refused() -> str:
    """Refuses a value of AT_ANSWER that has no meaning."""
    return "AT_ANSWER: id*10 +1 go 2 stay 3 look 4 other place"


def other_version() -> str:
    """Refuses an answer of another payload version."""
    return "Ground plug-in of another version: update it"


def refused(reason: str) -> str:
    """Refuses anything else, for `reason`."""
    return fit(f"Refused: {reason}")
