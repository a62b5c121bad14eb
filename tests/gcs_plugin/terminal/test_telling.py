"""What is told: lines for a person, objects for a program, and lines read from whoever types."""

from __future__ import annotations

import io
import json
import os
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from companion.wire import ids
from companion.wire.answers import Acknowledgement
from companion.wire.call_report import CallReport
from companion.wire.delivery import DeliveryStatus
from companion.wire.packing import where
from companion.wire.payloads import Summary
from gcs_plugin.client import events as ev
from gcs_plugin.client.policy_request import PolicyStatus
from gcs_plugin.client.rovers import TrackedRover
from gcs_plugin.client.vehicle import mode_name
from gcs_plugin.terminal import wording
from gcs_plugin.terminal.commands import parse
from gcs_plugin.terminal.output import JsonOutput, TextOutput, record, to_line
from gcs_plugin.terminal.runner import MAX_WAITING, Keyboard
from tests.golden import compare

ACK = Acknowledgement(
    5, 7, ids.Result.NOT_COVERED, ids.Stage.OPEN, ids.Outcome.NONE, 0.34, 0.7,
    ids.Reasons.UNKNOWN_OBJECT, 1, "still unknown",
)  # fmt: skip


@pytest.fixture
def all_events(thing_call: CallReport, quiet_summary: Summary) -> list[ev.Event]:
    closed = replace(thing_call, stage=ids.Stage.CLOSED, outcome=ids.Outcome.PASSED)
    return [
        ev.LinkChanged(1, up=True),
        ev.LinkChanged(1, up=False),
        ev.StateChanged(1, ids.State.FAULT, 8),
        ev.VehicleChanged(1, "HOLD", armed=True),
        ev.CallAnnounced(1, thing_call),
        ev.CallChanged(1, replace(thing_call, stage=ids.Stage.CLEAR)),
        ev.CallEnded(1, closed, 12.0),
        ev.SummaryReceived(1, quiet_summary),
        ev.TextReceived(1, 3, "C7 unknown thing\x1b[2J ahead"),
        ev.VehicleTextReceived(1, 2, "HOLD: companion silent"),
        ev.ParameterReceived(1, "AT_W_BUSH", -1.0),
        *(ev.AnswerStatusChanged(1, 7, 5, status) for status in DeliveryStatus),
        ev.Acknowledged(1, ACK),
        *(ev.PolicyStatusChanged(1, ids.Policy.HOLD, status) for status in PolicyStatus),
        ev.NotUnderstood(1, "payload version 2"),
    ]


def read(*events: ev.Event, at: Iterable[float] = (), colours: bool = False, several: bool = False) -> str:
    """What a person reads of events at these times in s, or all at 1 s."""
    page = io.StringIO()
    output = TextOutput(page, colours=colours)
    for event, now in zip(events, at or [1.0] * len(events), strict=True):
        output.event(event, now, several=several)
    return page.getvalue()


def test_every_event_is_one_object_on_one_line(all_events: list[ev.Event]) -> None:
    page = io.StringIO()
    output = JsonOutput(page, started=100.0)
    for event in all_events:
        output.event(event, 101.5, several=False)
    told = [json.loads(line) for line in page.getvalue().splitlines()]
    assert len(told) == len(all_events)
    assert {record["time"] for record in told} == {1.5}
    by_name = {record["event"]: record for record in told}
    assert by_name["call"]["worst_tile_box"] == [0.41, 0.55, 0.6, 0.81]
    assert (by_name["closed"]["outcome"], by_name["closed"]["after_s"]) == ("passed", 12.0)
    assert (by_name["ack"]["result"], by_name["ack"]["target"]) == ("not_covered", 7)
    assert by_name["ack"]["reasons"] == ["unknown_object"]
    assert by_name["summary"]["policy"] == "hold"


def test_a_person_never_gets_the_airs_control_characters_and_no_colours_unasked(
    all_events: list[ev.Event],
) -> None:
    text = read(*all_events, several=True)
    assert all(line.isprintable() for line in text.splitlines())
    assert 'rover 1: says "C7 unknown thing [2J ahead"' in text
    assert "rover 1: answer to 7: taken, but it does not cover what was seen, now 34% unexplained" in text


def test_a_call_is_worded_as_its_rover_words_it(thing_call: CallReport) -> None:
    thing = replace(thing_call, why="unknown 71% in yellow frame, over 25% calls")
    assert "C7 unknown 71% in yellow frame, over 25% calls, in the middle [vehicle held" in read(
        ev.CallAnnounced(1, thing)
    )
    place = replace(thing_call, reasons=ids.Reasons.UNKNOWN_SCENE, why="new place, .91 like C3, .94 needed")
    assert "C7 new place, .91 like C3, .94 needed [vehicle held" in read(ev.CallAnnounced(1, place))
    both = replace(thing, reasons=ids.Reasons.UNKNOWN_OBJECT | ids.Reasons.BLOCKED)
    assert "over 25% calls, in the middle; blocked by what it knows, 90%" in read(ev.CallAnnounced(1, both))


def test_colours_are_there_when_asked_for(thing_call: CallReport) -> None:
    assert "\033[1;31mC7" in read(ev.CallAnnounced(1, thing_call), colours=True)


@pytest.mark.parametrize(("severity", "colour"), [(1, "1;31"), (2, "1;31"), (4, ""), (6, "2")])
def test_an_alert_looks_like_one_and_news_do_not(severity: int, colour: str) -> None:
    text = read(ev.TextReceived(1, severity, "H9 HOLD FAILED: STOP BY HAND"), colours=True)
    said = 'says "H9 HOLD FAILED: STOP BY HAND"'
    assert text.rstrip("\n").endswith(f"\033[{colour}m{said}\033[0m" if colour else f"  {said}")


def test_a_text_that_repeats_is_read_once_a_minute() -> None:
    again = [ev.TextReceived(1, 3, "C7 still here")] * 8
    assert read(*again, at=range(0, 120, 15)).count("C7 still here") == 2


def test_a_text_whose_figure_alone_changes_is_a_repeat() -> None:
    texts = [f"C1 blocked {figure}% drivable: waiting" for figure in (80, 81, 80, 79)]
    assert read(*(ev.TextReceived(1, 4, text) for text in texts)).count("waiting") == 1


def test_a_text_that_the_autopilot_brought_first_is_read_once() -> None:
    text = "C7 FAULT camera silent"
    brought, own = ev.VehicleTextReceived(1, 3, text), ev.TextReceived(1, 3, text)
    assert read(brought, own, at=(1.0, 1.3)).count("C7 FAULT") == 1


def test_that_the_companion_is_back_and_the_scripts_hold_stands_is_read_as_the_script_says_it() -> None:
    pytest.importorskip("lupa.lua53", reason="the script runs in Lua 5.3")
    from tests.companion.sim.field.stubs import driving

    board = driving()
    board.pass_time(3.0)
    board.pass_time(25.0, state=ids.State.OK)
    rover = TrackedRover(1)
    heard = [
        (event, said.t)
        for said in board.said
        for event in rover.handle_vehicle_text(said.severity, said.text, said.t)
    ]
    text = read(*(event for event, _ in heard), at=[at for _, at in heard])
    assert [line[10:] for line in text.splitlines()] == [
        'autopilot says "HOLD: companion silent. AUTO again = go blind"',
        'autopilot says "Companion is back: nothing resumes by itself"',
        'autopilot says "HOLD since companion silent: set AUTO by hand"',
    ]


@pytest.mark.parametrize(
    ("state", "number", "told"),
    [
        (
            ids.State.HOLDING,
            0,
            "companion sees; the vehicle is HELD, not by the companion: its text says by whom",
        ),
        (ids.State.HOLDING, 3, None),
        (ids.State.CALLING, 3, None),
        (ids.State.OK, 0, "companion ok"),
    ],
)
def test_a_hold_that_is_not_the_companions_is_never_told_as_ok(
    state: ids.State, number: int, told: str | None
) -> None:
    text = read(ev.StateChanged(1, state, number))
    assert [line[10:] for line in text.splitlines()] == ([] if told is None else [told])


def test_that_the_vehicle_is_held_now_is_told_without_the_rest(thing_call: CallReport) -> None:
    opened = ev.CallAnnounced(1, replace(thing_call, holding=False))
    told = read(opened, ev.CallChanged(1, thing_call)).splitlines()[len(read(opened).splitlines()) :]
    assert [line.split("  ")[1] for line in told] == ["C7 vehicle held"]


def test_a_reason_that_comes_and_goes_is_read_once(thing_call: CallReport) -> None:
    opened = ev.CallAnnounced(1, thing_call)
    both = replace(thing_call, reasons=ids.Reasons.UNKNOWN_OBJECT | ids.Reasons.BLOCKED)
    calls = (both, thing_call, both, thing_call, replace(both, stage=ids.Stage.CLEAR))
    text = read(opened, *(ev.CallChanged(1, call) for call in calls))
    told = text.splitlines()[len(read(opened).splitlines()) :]
    assert ["blocked" in told[0], "can drive on now" in told[1], len(told)] == [True, True, 2]


def test_a_picture_that_can_be_fetched_is_told_with_what_to_type(thing_call: CallReport) -> None:
    there = replace(thing_call, picture="/calls/7.jpg")
    assert "  picture  at picture 7" in wording.call_lines(there, 0.0, "at ")
    hold = replace(there, kind=ids.Kind.HOLD, reasons=ids.Reasons.BLOCKED)
    assert "  look at  0.41 0.55 0.60 0.81" in wording.call_lines(hold, 0.0)
    assert not any("picture" in line for line in wording.call_lines(replace(thing_call, picture=""), 0.0))


_SHARES = st.none() | st.floats(0, 1)


@settings(max_examples=60, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    kind=st.sampled_from(ids.Kind),
    stage=st.sampled_from(ids.Stage),
    reasons=st.integers(0, 255).map(ids.Reasons),
    box=st.none() | st.just((0.1, 0.2, 0.3, 0.4)),
    share=_SHARES,
    picture=st.text(max_size=20),
)
def test_every_call_has_a_headline_and_answers_that_can_be_typed(
    thing_call: CallReport,
    kind: ids.Kind,
    stage: ids.Stage,
    reasons: ids.Reasons,
    box: tuple[float, float, float, float] | None,
    share: float | None,
    picture: str,
) -> None:
    call = replace(
        thing_call, kind=kind, stage=stage, reasons=reasons, worst_tile_box=box, roi_uncertainty=share,
        drivable_share=share, similarity=share, picture=picture,
    )  # fmt: skip
    assert wording.call_lines(call, 3.0)[0].isprintable()
    for line in wording.fitting_answers(call):
        parse(line.replace("THING", "drum").replace("GROUND", "grass"))


@pytest.mark.parametrize(
    ("box", "told"),
    [
        ((0.1, 0, 0.3, 1), "at the left"),
        ((0.4, 0, 0.6, 1), "in the middle"),
        ((0.7, 0, 0.9, 1), "at the right"),
        ((0.01, 0, 0.2, 1), "at the left edge"),
        ((0.8, 0, 1, 1), "at the right edge"),
        ((0, 0, 1, 1), "in the middle"),
    ],
)
def test_where_a_box_lies(box: tuple[float, float, float, float], told: str) -> None:
    assert where(box) == told


@pytest.mark.parametrize(
    ("seconds", "told"), [(3.4, "3 s"), (600.0, "10 min"), (9000.0, "2 h"), (float("inf"), "ever")]
)
def test_durations(seconds: float, told: str) -> None:
    assert wording.duration(seconds) == told


@pytest.mark.parametrize(
    ("autopilot", "custom_mode", "name"),
    [
        (3, 10, "AUTO"), (3, 4, "HOLD"), (3, 99, "MODE 99"), (12, 0x04040000, "AUTO.MISSION"),
        (12, 0x03040000, "AUTO.LOITER"), (12, 0x00060000, "OFFBOARD"), (8, 5, "MODE 5"),
    ],
)  # fmt: skip
def test_modes_have_their_autopilots_names(autopilot: int, custom_mode: int, name: str) -> None:
    assert mode_name(autopilot, custom_mode) == name


@pytest.fixture
def pipe() -> Callable[[], tuple[Keyboard, int]]:
    def made() -> tuple[Keyboard, int]:
        reading, writing = os.pipe()
        return Keyboard(reading), writing

    return made


def test_lines_come_when_they_are_complete(pipe: Callable[[], tuple[Keyboard, int]]) -> None:
    keyboard, writing = pipe()
    assert keyboard.lines() == []
    os.write(writing, b"go\nst")
    assert keyboard.lines() == ["go"]
    os.write(writing, b"ay\nlook \xff")
    assert keyboard.lines() == ["stay"]
    assert keyboard.descriptors() != []
    os.close(writing)
    assert keyboard.lines() == ["look \ufffd"]
    assert keyboard.ended
    assert keyboard.descriptors() == []


def test_an_endless_line_is_cut(pipe: Callable[[], tuple[Keyboard, int]]) -> None:
    keyboard, writing = pipe()
    cut: list[str] = []
    for _ in range(MAX_WAITING // 4096 + 1):
        os.write(writing, b"x" * 4096)
        cut += keyboard.lines()
    os.close(writing)
    assert [len(line) for line in cut] == [MAX_WAITING + 4096]


def test_nobody_types_at_dev_null() -> None:
    with open(os.devnull) as nothing:
        keyboard = Keyboard.of(nothing)
        assert keyboard.lines() == []
        assert not keyboard.ended


def test_a_test_call_says_that_it_is_one_when_it_opens_and_when_it_closes(
    thing_call: CallReport,
) -> None:
    test = replace(thing_call, test=True, reasons=ids.Reasons.NONE, holding=False, worst_tile_box=None)
    assert wording.headline(test, 3) == "C7 TEST, nothing is wrong [vehicle not held, 3 s]"
    assert wording.fitting_answers(test) == ["go", "stay"]
    closed = replace(test, stage=ids.Stage.CLOSED, outcome=ids.Outcome.ANSWERED)
    assert "C7 TEST closed: answered" in wording.closed(closed, 4)
    assert "nobody answered" in wording.closed(replace(closed, outcome=ids.Outcome.PASSED), 60)
    assert "TEST closed: over" in wording.closed(replace(closed, outcome=ids.Outcome.NONE), 2)


def test_every_event_is_told_to_a_program_as_before(all_events: list[ev.Event]) -> None:
    lines = [to_line(record(event, 1.5)) for event in all_events]
    compare(Path(__file__).with_name("golden_events.json"), {str(at): line for at, line in enumerate(lines)})


def test_faults_of_one_hold_that_take_turns_share_a_line_with_a_count() -> None:
    texts = [f"H9 FAULT {('camera silent', 'vision hangs')[turn % 2]}" for turn in range(8)]
    events = [ev.TextReceived(1, 3, text) for text in texts]
    told = read(*events, at=tuple(10.0 * turn for turn in range(8)))
    assert [line.partition("says ")[2] for line in told.splitlines()] == [
        '"H9 FAULT camera silent"',
        '"H9 FAULT camera silent, vision hangs: 2 times in 10 s"',
        '"H9 FAULT camera silent, vision hangs: 7 times in 60 s"',
    ]


def test_a_state_that_goes_to_fault_and_back_in_one_call_is_told_once_a_minute_with_a_count() -> None:
    states = [ids.State.FAULT, ids.State.CALLING] * 8
    events = [ev.StateChanged(1, state, 1) for state in states]
    told = read(*events, at=tuple(5.0 * turn for turn in range(16)))
    assert [line.partition("  ")[2] for line in told.splitlines()] == [
        "companion FAULT: it cannot judge (1)",
        "companion FAULT: it cannot judge (1): 7 times in 60 s",
    ]


def test_faults_without_a_call_are_counted_anew_after_the_state_has_left_fault() -> None:
    said = [ev.TextReceived(1, 3, f"Companion FAULT: {name}") for name in ("camera silent", "vision hangs")]
    told = read(*said, ev.StateChanged(1, ids.State.OK, 0), said[0], at=(0.0, 1.0, 100.0, 200.0))
    assert told.splitlines()[-1].endswith('says "Companion FAULT: camera silent"')
