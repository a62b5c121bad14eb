"""Words calls, answers and states for a person."""

from __future__ import annotations

import math
from collections.abc import Iterator

from companion.wire.answers import Acknowledgement
from companion.wire.call_report import CallReport
from companion.wire.delivery import result_text
from companion.wire.ids import Outcome, Policy, Reasons, Stage, State, words_hash
from companion.wire.messages import MESSAGES
from companion.wire.packing import where
from companion.wire.parameters import SHADOW_HOLDS, SHADOW_HOURS, SHADOW_REASONS
from companion.wire.texts import name, percent
from gcs_plugin.client.policy_request import PolicyStatus
from gcs_plugin.client.rovers import ComputerReport, TrackedRover
from gcs_plugin.terminal.commands import GROUND, THING

_OLD_FIGURES_S = 2.0 * (MESSAGES["computer"].period or 0.0)
_STATES = {
    State.STARTING: "starting",
    State.OK: "ok",
    State.CALLING: "CALLING",
    State.HOLDING: "HOLDING the vehicle",
    State.BLOCKED: "way blocked",
    State.FAULT: "FAULT: it cannot judge",
    State.OFF: "OFF: nobody watches the trail",
}
_POLICY_MEANINGS = {
    Policy.REPORT: "it calls, and holds nothing",
    Policy.SHADOW: "it calls, holds nothing, and counts what it would have held",
    Policy.HOLD: "it holds the vehicle, and drives on only after a go",
    Policy.OFF: "nobody watches the trail, and a hold is let go",
    Policy.GUIDE: "it holds, and drives round what leaves room",
}
_HOLDING = {True: "vehicle held", False: "vehicle not held"}
_ADDED_REASONS = {
    Reasons.UNKNOWN_OBJECT: "an unknown thing ahead",
    Reasons.UNKNOWN_SCENE: "a new place",
    Reasons.BLOCKED: "blocked by what it knows",
    Reasons.FAULT: "no picture that can be judged",
}
_STAGES = {Stage.ANSWERED: "answered, waits until the way is clear", Stage.CLEAR: "can drive on now, go?"}
_OUTCOMES = {
    Outcome.NONE: "over (how was lost on the way)",
    Outcome.ANSWERED: "answered",
    Outcome.ACCEPTED: "accepted",
    Outcome.PASSED: "passed by itself",
    Outcome.TAKEN_OVER: "taken over, not by the companion",
    Outcome.RECOVERED: "fault is gone",
    Outcome.SWITCHED_OFF: "companion switched off",
}
_TEST_OUTCOMES = {
    Outcome.ANSWERED: "answered, the way there and back works",
    Outcome.PASSED: "nobody answered it",
}


def why(call: CallReport) -> str:
    """Word all reasons of a call with their figures: `unknown 91% in yellow frame, over 85% calls, ...`."""
    return "; ".join(_reasons(call)) or "no reason given"


def _reasons(call: CallReport) -> Iterator[str]:
    if call.test:
        yield "TEST, nothing is wrong"
    asks = call.reasons & (Reasons.UNKNOWN_OBJECT | Reasons.UNKNOWN_SCENE)
    if asks and call.why:
        points = call.reasons & Reasons.UNKNOWN_OBJECT and call.worst_tile_box
        there = where(call.worst_tile_box) if points and call.worst_tile_box else ""
        at_edge = "something " if there.endswith("edge") else ""
        yield call.why + (f", {at_edge}{there}" if there else "")
    elif asks:
        yield from _asking(call)
    if call.reasons & Reasons.BLOCKED:
        yield f"blocked by what it knows, {percent(call.drivable_share)} of the known ground drivable"
    if call.reasons & Reasons.FAULT:
        yield "fault: no picture that can be judged"


def _asking(call: CallReport) -> Iterator[str]:
    """Word why a call asks by its figures, where the rover's own text of it was not received."""
    if call.reasons & Reasons.UNKNOWN_OBJECT:
        worst = (
            f", most {where(call.worst_tile_box)} ({percent(call.worst_tile)})" if call.worst_tile_box else ""
        )
        there = where(call.worst_tile_box) if call.worst_tile_box else ""
        thing = f"something {there}" if there.endswith("edge") else "unknown thing ahead"
        yield f"{thing}, {percent(call.roi_uncertainty)} unexplained{worst}"
    if call.reasons & Reasons.UNKNOWN_SCENE:
        known = "" if call.similarity is None else f", {call.similarity:.2f} like a known one"
        yield f"new place{known}"


def fitting_answers(call: CallReport, before: str = "") -> list[str]:
    """Return lines that make sense as an answer to this call now; before: what is typed before each."""
    return [before + line for line in _fitting_lines(call)]


def _fitting_lines(call: CallReport) -> list[str]:
    if call.test:
        return ["go", "stay"]
    if call.stage is not Stage.OPEN:
        return ["go", "stay", "look"]
    if call.reasons & Reasons.UNKNOWN_OBJECT:
        tap = [f"tap {THING} -1 go"] if call.worst_tile_box else []
        return [*tap, f"{THING}: -1, go", "go", "stay", "look"]
    if call.reasons & Reasons.UNKNOWN_SCENE:
        return [f"{GROUND}: 1, go", "go", "stay", "look"]
    if call.reasons & Reasons.FAULT:
        return ["look", "stay"]
    return ["go", "stay", "look"]


def headline(call: CallReport, age: float) -> str:
    """Word a call in one line: its id, why it calls, whether the vehicle is held, and its age."""
    stands = _HOLDING[call.holding]
    asks = _STAGES.get(call.stage, why(call))
    return f"{name(call.kind, call.id)} {asks} [{stands}, {duration(age)}]"


def call_lines(call: CallReport, age: float, before: str = "") -> list[str]:
    """Word a call in several lines: headline, box to look at, how to fetch a picture, fitting answers."""
    lines = [headline(call, age)]
    if call.worst_tile_box and call.stage is Stage.OPEN:
        lines.append("  look at  " + " ".join(f"{side:.2f}" for side in call.worst_tile_box))
    if call.picture:
        lines.append(f"  picture  {before}picture {call.id}")
    lines.append("  answer   " + "  |  ".join(fitting_answers(call, before)))
    return lines


def changed(call: CallReport, age: float, before: str = "") -> str:
    """Word an open call that has another stage or more reasons."""
    answers = "" if call.stage is Stage.ANSWERED else f": {' | '.join(fitting_answers(call, before))}"
    return headline(call, age) + answers


def also(call: CallReport, added: Reasons, before: str = "") -> str:
    """Word reasons that came later, without figures: those of the call are of its own frame."""
    named = " and ".join(text for reason, text in _ADDED_REASONS.items() if added & reason)
    return f"{name(call.kind, call.id)} also {named}: {' | '.join(fitting_answers(call, before))}"


def alert(system: int, call: CallReport) -> tuple[str, str]:
    """Word a call for who is not at the console: a title, and what it is about, with its place."""
    named = f"Rover {system} calls: {name(call.kind, call.id)}"
    place = "" if call.latitude is None else f"\nat {call.latitude:.5f} {call.longitude:.5f}"
    return named, headline(call, call.age_s) + place


def stands(call: CallReport) -> str:
    """Word a call of which only the holding of the vehicle has changed."""
    return f"{name(call.kind, call.id)} {_HOLDING[call.holding]}"


def closed(call: CallReport, after_s: float) -> str:
    """Word a call that is closed."""
    test = " TEST" if call.test else ""
    how = outcome(call.outcome, test=call.test)
    return f"{name(call.kind, call.id)}{test} closed: {how}, after {duration(after_s)}"


def acknowledged(ack: Acknowledgement) -> str:
    """Word the acknowledgement of an answer, with the figures of the call's frame judged again."""
    return f"answer to {ack.target or 'no call'}: {result_text(ack)}"


def outcome(value: Outcome, *, test: bool = False) -> str:
    """Word how a call was closed."""
    return _TEST_OUTCOMES.get(value, "over") if test else _OUTCOMES[value]


def given_up(target: int) -> str:
    """Word an answer that was not acknowledged when the program ended."""
    return f"answer to {target or 'no call'} is not acknowledged, and given up"


def state(value: State, current_id: int) -> str:
    """Word the companion's state. A hold without an id is not the companion's own: its text says whose."""
    if value is State.HOLDING and not current_id:
        return "companion sees; the vehicle is HELD, not by the companion: its text says by whom"
    about = f" ({current_id})" if current_id else ""
    return f"companion {_STATES[value]}{about}"


def policy(value: Policy, status: PolicyStatus) -> str:
    """Word a policy request and its status."""
    became = {
        PolicyStatus.WAITING: "waits: the companion is not heard",
        PolicyStatus.SENT: "asked for",
        PolicyStatus.GRANTED: f"is in force: {_POLICY_MEANINGS[value]}",
        PolicyStatus.REFUSED: "REFUSED: its text says why",
        PolicyStatus.EXPIRED: "LOST: no word within 60 s",
    }
    return f"policy {value.name.lower()} {became[status]}"


def status_lines(rover: TrackedRover, now: float) -> list[str]:
    """Word all that is known of a rover in a few lines."""
    heard = "heard" if rover.alive(now) else f"NOT HEARD for {duration(rover.silence(now))}"
    drives = "vehicle unknown" if rover.vehicle is None else rover.vehicle.text
    doing = "state unknown" if rover.state is None else state(rover.state, rover.current_id)
    lines = [f"rover {rover.system}: {heard}, {doing}, {drives}"]
    if rover.policy is not None:
        lines.append(f"  policy   {rover.policy.name.lower()}")
    if rover.braking:
        lines.append("  hold     under way: the autopilot's script brakes first, in GUIDED")
    if rover.guiding:
        lines.append("  guiding  it drives round something, in GUIDED, and gives AUTO back then")
    if rover.fault_accepted:
        lines.append("  fault    holds nobody now: driven on by hand (20 s, 10 m at most) or mission over")
    summary, counters = rover.summary, rover.counters
    if summary is not None:
        place = "" if summary.similarity is None else f", {summary.similarity:.2f} like the known place"
        drivable, unknown = percent(summary.roi_traversability), percent(summary.roi_uncertainty)
        lines.append(f"  ahead    {drivable} drivable, {unknown} unexplained{place}")
        lines.append(
            f"  link     {counters.summaries} summaries, {counters.summaries_lost} lost; "
            f"picture {summary.frame_age_ms} ms old when sent"
        )
    if rover.computer is not None:
        lines.append(f"  computer {computer(rover.computer, now)}")
    if rover.parameters.get(SHADOW_HOLDS) or rover.parameters.get(SHADOW_HOURS):
        lines.append(f"  shadow   {shadow(rover)}")
    return lines


def computer(told: ComputerReport, now: float) -> str:
    """Word what the companion's computer said of itself, and when; what it does not tell is left out."""
    age = now - told.received_at
    parts = (
        "no temperature told" if told.temperature is None else f"{told.temperature} C",
        "SLOWED DOWN: it sees late" if told.throttled else "",
        "its supply's voltage is TOO LOW" if told.under_voltage else "",
        "its disk is FULL" if told.disk_full else "",
        "" if told.cpu is None else f"CPU {percent(told.cpu)}",
        f"said {duration(age)} ago" if age > _OLD_FIGURES_S else "",
    )
    return ", ".join(part for part in parts if part)


def shadow(rover: TrackedRover) -> str:
    """Word what shadow policy would have held, from the rover's parameters."""
    told = rover.parameters
    holds, hours = told.get(SHADOW_HOLDS, 0.0), told.get(SHADOW_HOURS, 0.0)
    rate = f", {holds / hours:.1f} an hour" if hours else ""
    counts = {reason.replace("_", " "): told.get(name, 0.0) for reason, name in SHADOW_REASONS.items()}
    named = ", ".join(f"{reason} {count:.0f}" for reason, count in counts.items() if count)
    return f"{holds:.0f} would-be holds in {hours:.1f} h{rate}" + (f" ({named})" if named else "")


def words_lines(rover: TrackedRover) -> list[str]:
    """List the words in use that parameters hold; add a note when the summary's hash shows others."""
    words = rover.words()
    if not words:
        return [f"rover {rover.system}: its words are not told yet, ask again in a few seconds"]
    told = "; ".join(f"{word}: {value:g}" for word, value in words.items())
    lines = [f"rover {rover.system}: {told}"]
    if rover.summary is not None and rover.summary.words != words_hash(words):
        lines.append("  these are not all, or spelled otherwise there: ask again in a few seconds;")
        lines.append("  words that no parameter holds are in its /state.json")
    return lines


def calls_lines(rover: TrackedRover, now: float) -> list[str]:
    """List what is open, one line each, or say that nothing is.

    The heartbeat may name a call before the call's data is received.
    """
    waiting = [headline(call.data, call.age(now)) for call in rover.open_calls()]
    if waiting or not rover.current_id:
        return waiting or [f"rover {rover.system}: nothing is open"]
    return [f"rover {rover.system}: {rover.current_id} is open; what it is about is told again within 10 s"]


def duration(seconds: float) -> str:
    """Word a duration: `12 s`, `3 min` or `2 h`."""
    if not math.isfinite(seconds):
        return "ever"
    if seconds < 120:
        return f"{seconds:.0f} s"
    return f"{seconds / 60:.0f} min" if seconds < 7200 else f"{seconds / 3600:.0f} h"
