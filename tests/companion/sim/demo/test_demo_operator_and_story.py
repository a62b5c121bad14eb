"""The demo's operator, its counts and its story, on events as the operator's side prints them."""

from __future__ import annotations

import io
from typing import Any

import pytest

from companion.sim.demo import story as story_module
from companion.sim.demo.answers import HEARS_WITHIN, THINK, WORDS_FOR_PLACE, AutoOperator
from companion.sim.demo.onlooker import Shown
from companion.sim.demo.story import QUIET, Story
from companion.sim.demo.tally import DemoTally
from companion.sim.demo.verdict import about_the_computer, missing, missing_guided, verdict
from companion.sim.field.render import GROUND_KINDS
from companion.sim.field.trail import ZONES
from companion.wire.ids import Motion
from companion.wire.typed_answers import read_typed
from tests.waiting import wait_for


def call(**changed: Any) -> dict[str, Any]:
    """A call for an unknown thing."""
    return {
        "event": "call",
        "id": 3,
        "kind": "call",
        "stage": "open",
        "reasons": ["unknown_object"],
        "frame_id": 41,
        "roi_uncertainty": 0.25,
        "worst_tile": 0.9,
        "similarity": 0.97,
    } | changed


def drum(place: str = "meadow") -> Shown:
    return Shown("drum", place, thing="drum-1", surprise=True)


def ground(place: str, kind: str = "dirt path") -> Shown:
    return Shown(kind, place, patch=f"{kind}, {place}, path")


def answers(operator: AutoOperator, event: dict[str, Any], shown: Shown) -> list[str]:
    """What is typed within a minute."""
    typed = (operator.answer(event, shown, tick / 10) for tick in range(600))
    return [line for line in typed if line is not None]


def test_a_call_is_looked_at_before_it_is_answered() -> None:
    operator = AutoOperator()
    assert operator.answer(call(), drum(), 10.0) is None
    assert operator.answer(call(), drum(), 10.0 + THINK / 2) is None
    assert operator.answer(call(), drum(), 10.0 + THINK) == "tap drum -1 go"


@pytest.mark.parametrize("place", ZONES)
@pytest.mark.parametrize("thing", [True, False])
@pytest.mark.parametrize("kind", ["call", "hold"])
@pytest.mark.parametrize("stage", ["open", "clear"])
@pytest.mark.parametrize(
    "reasons", [["unknown_scene"], ["unknown_object"], ["unknown_object", "unknown_scene"]]
)
def test_every_call_is_answered_but_a_hold_for_a_thing_that_is_still_there(
    place: str, thing: bool, kind: str, stage: str, reasons: list[str]
) -> None:
    shown = drum(place) if thing else ground(place)
    typed = answers(AutoOperator(), call(kind=kind, stage=stage, reasons=reasons), shown)
    assert bool(typed) == (kind == "call" or stage == "clear" or not thing)


@pytest.mark.parametrize("place", ZONES)
def test_a_thing_that_the_call_shows_is_never_waved_through(place: str) -> None:
    typed = answers(AutoOperator(), call(), drum(place))
    assert typed == ["tap drum -1 go"] * 3
    both = answers(AutoOperator(), call(reasons=["unknown_object", "unknown_scene"]), drum(place))
    assert both == [f"{WORDS_FOR_PLACE[place]}, go", "tap drum -1 go", "tap drum -1 go"]


def test_a_thing_of_which_the_box_has_a_corner_is_tapped_where_it_is() -> None:
    corner = Shown("drum", "meadow", thing="drum-1", surprise=True, outline=[0.25, 0.4, 0.3125, 0.5])
    typed = answers(AutoOperator(), call(), corner)
    assert typed[0] == "tap drum -1 0.2500 0.4000 0.3125 0.5000 go"
    assert read_typed(typed[0]).motion is Motion.GO


@pytest.mark.parametrize("place", ZONES)
@pytest.mark.parametrize("kind", GROUND_KINDS)
def test_a_call_about_ground_teaches_which_ground_it_is_before_it_is_waved_through(
    place: str, kind: str
) -> None:
    word = "dry grass" if (place, kind) == ("gravel", "grass") else kind
    typed = answers(AutoOperator(), call(), ground(place, kind))
    assert typed[0] == f"tap {word} 1 go"
    assert set(typed[1:]) == {"go"}
    both = answers(AutoOperator(), call(reasons=["unknown_object", "unknown_scene"]), ground(place, kind))
    assert both[0] == f"{WORDS_FOR_PLACE[place]}, go"
    assert set(both[1:]) == {"go"}


def test_a_call_that_became_clear_gets_one_go() -> None:
    operator = AutoOperator()
    answers(operator, call(), drum())
    assert answers(operator, call(stage="clear"), ground("meadow")) == ["go"]


def test_a_thing_that_stands_there_though_the_rover_takes_its_way_for_clear_is_named() -> None:
    operator, clear = AutoOperator(), call(stage="clear", reasons=["unknown_object", "unknown_scene"])
    typed = [operator.answer(clear, drum(), tick / 10, stands_there=True) for tick in range(20)]
    assert [line for line in typed if line is not None] == ["tap drum -1 go"]
    operator.answer(call(stage="answered"), drum(), 2.0, stands_there=True)
    typed = [operator.answer(clear, drum(), 2.0 + tick / 10, stands_there=False) for tick in range(20)]
    assert [line for line in typed if line is not None] == ["go"], "it was taken away"


def test_a_hold_that_became_clear_gets_no_go_while_its_thing_stands_there() -> None:
    operator, clear = AutoOperator(), call(kind="hold", stage="clear")
    typed = [operator.answer(clear, drum(), tick / 10, stands_there=tick < 300) for tick in range(600)]
    assert [tick for tick, line in enumerate(typed) if line is not None] == [300]


def test_an_answer_is_waited_for_and_one_that_came_too_early_is_given_again() -> None:
    operator = AutoOperator()
    assert operator.answer(call(), drum(), 10.0) is None
    assert operator.answer(call(), drum(), 11.0) == "tap drum -1 go"
    assert operator.answer(call(), drum(), 11.0 + HEARS_WITHIN - 1) is None
    operator.heard(3, "busy")
    assert operator.answer(call(), drum(), 12.0) == "tap drum -1 go"
    operator.heard(3, "not_covered")
    assert operator.answer(call(), drum(), 14.0) == "tap drum -1 go"
    assert operator.answer(call(), drum(), 14.0 + HEARS_WITHIN) == "tap drum -1 go"
    operator.heard(9, "busy")  # of nobody


def test_answered_and_blocked_calls_are_left_alone() -> None:
    assert answers(AutoOperator(), call(stage="answered"), drum()) == []


def asked(tally: DemoTally, number: int, shown: Shown, metres: float, *reasons: str) -> None:
    """A call is opened and answered."""
    event = call(id=number, reasons=list(reasons))
    tally.asked_about(event, shown, metres)
    tally.answered(event, shown, metres)


def test_things_and_places_are_counted_once_and_what_is_asked_again_is_a_repeat() -> None:
    tally = full_tally()
    asked(tally, 1, drum(), 10.0, "unknown_object")
    asked(tally, 2, ground("forest"), 20.0, "unknown_scene")
    asked(tally, 3, ground("forest"), 24.0, "unknown_object")
    assert tally.repeat_calls == 0
    asked(tally, 4, drum(), 30.0, "unknown_object")
    asked(tally, 5, ground("forest"), 60.0, "unknown_scene")
    asked(tally, 6, ground("forest"), 61.0, "unknown_object")
    figures = tally.figures(FIELD, DAEMON, seconds=10.0)
    assert (figures["things"], figures["places"], figures["repeat_calls"]) == (1, 1, 2)


def test_the_story_says_what_a_call_is_about_and_that_it_was_asked_before() -> None:
    tally = DemoTally()
    event = call(id=1, reasons=["unknown_object", "unknown_scene"])
    assert tally.asked_about(event, drum("forest"), 10.0) == "call 1 is about forest and drum-1"
    tally.answered(event, drum("forest"), 10.0)
    assert tally.asked_about(call(id=2), drum(), 12.0) == "call 2 is about drum-1, AGAIN"


FIELD = {
    "mode_log": [
        {"mode": "AUTO", "by": "operator"},
        {"mode": "HOLD", "by": "companion"},
        {"mode": "AUTO", "by": "companion"},
    ],
    "contacts": [],
    "bytes": {"gcs": {"from_companion": 2000}},
}
DAEMON = {
    "frames": 20,
    "recent": [[number, number / 10, number / 10 + 0.02] for number in range(21)],
    "judging": {"rate": 10.0},
}


def full_tally() -> DemoTally:
    """All events that a good demo has."""
    tally = DemoTally()
    events = [
        call(id=1),
        call(id=2, reasons=["unknown_scene"]),
        call(id=3, kind="hold", reasons=["blocked"]),
        {"event": "ack", "result": "applied", "text": ""},
        {"event": "ack", "result": "not_covered", "text": ""},
        {"event": "ack", "result": "busy", "text": ""},
        {"event": "closed", "id": 1, "kind": "call", "outcome": "answered"},
        {"event": "closed", "id": 3, "kind": "hold", "outcome": "answered"},
        {"event": "text", "text": "Known place again: words of C2"},
        {"event": "text", "text": "C1 holding"},
        {"event": "state", "state": "blocked", "current_id": 1},
        {"event": "state", "state": "blocked", "current_id": 2},
        {"event": "state", "state": "ok", "current_id": 0},
        {"event": "summary", "frame_id": 5},
        {"event": "summary", "frame_id": 15},
        {"event": "summary", "frame_id": 99},
    ]
    for event in events:
        tally.event(event, at=0.6 if event.get("frame_id") == 5 else 1.7)
    tally.typed("1 tap drum -1 go")
    tally.typed("grass: 1, go")
    tally.typed("go")
    return tally


def test_the_tally_counts_what_was_heard() -> None:
    figures = full_tally().figures(FIELD, DAEMON, seconds=10.0)
    assert figures == {
        "frames": 20,
        "fps": 10.0,
        "fps_aimed_at": 10.0,
        "slowed_down": 0,
        "calls": 2,
        "calls_unknown_object": 1,
        "calls_unknown_scene": 1,
        "answers": 2,
        "answers_by_tap": 1,
        "answers_by_words": 1,
        "things": 0,
        "places": 0,
        "repeat_calls": 0,
        "closed_unanswered": 0,
        "history_matches": 1,
        "returned_without_call": False,
        "holds": 1,
        "driven_round": 0,
        "resumes": 1,
        "taken_over": 0,
        "blocked": 1,
        "kept_off_named_things": 0,
        "collisions": 0,
        "bytes_per_s": 200.0,
        "summaries_received": 3,
        "latency_ms_p50": 150.0,
        "latency_ms_max": 200.0,
        "seconds": 10.0,
    }


def test_a_hold_that_a_human_ended_by_driving_on_is_no_resume_and_is_named() -> None:
    modes = [
        ("AUTO", "hand"),
        ("HOLD", "companion"),
        ("AUTO", "companion"),
        ("HOLD", "companion"),
        ("AUTO", "hand"),
    ]
    field = {**FIELD, "mode_log": [{"t": 0.0, "mode": mode, "by": by} for mode, by in modes]}
    tally = full_tally()
    tally.taken_over = 1
    figures = tally.figures(field, DAEMON, seconds=10.0)
    assert (figures["holds"], figures["resumes"], figures["taken_over"]) == (2, 1, 1)


@pytest.mark.parametrize(("resumes", "taken_over", "shown"), [(2, 0, True), (1, 1, True), (0, 2, False)])
def test_a_demo_is_shown_where_the_companion_resumed_after_all_holds_that_no_human_ended(
    resumes: int, taken_over: int, shown: bool
) -> None:
    left = missing({**GOOD, "resumes": resumes, "taken_over": taken_over})
    assert (left == []) is shown


def test_a_tally_of_nothing_has_figures_and_lacks_nearly_all() -> None:
    empty = {"mode_log": [], "contacts": [], "bytes": {"gcs": {"from_companion": 0}}}
    figures = DemoTally().figures(empty, {}, seconds=0.0)
    assert figures["latency_ms_p50"] is None
    shown = {"no contact with anything", "at most 300 bytes per second"}
    assert len(missing({**figures, "hold_refused": ""})) == 12
    assert not shown & set(missing({**figures, "hold_refused": ""}))


GOOD: dict[str, Any] = {
    "calls": 2,
    "calls_unknown_object": 1,
    "calls_unknown_scene": 1,
    "answers": 2,
    "answers_by_tap": 1,
    "answers_by_words": 1,
    "holds": 2,
    "resumes": 2,
    "taken_over": 0,
    "kept_off_named_things": 1,
    "returned_without_call": True,
    "history_matches": 1,
    "collisions": 0,
    "hold_refused": "",
    "bytes_per_s": 300.0,
    "summaries_received": 1,
}


def test_a_demo_that_showed_all_ends_with_0() -> None:
    stream = io.StringIO()
    assert verdict(GOOD, Story(stream)) == 0
    assert "All of the job was shown." in stream.getvalue()


@pytest.mark.parametrize(
    ("name", "value"),
    [
        (name, type(value)(value - 1))
        for name, value in GOOD.items()
        if name not in {"collisions", "bytes_per_s", "hold_refused"}
    ]
    + [
        ("collisions", 1),
        ("bytes_per_s", 301.0),
        ("hold_refused", "HOLD refused: 0.5 s a frame: make it faster"),
    ],
)
def test_each_figure_that_falls_short_is_named(name: str, value: float) -> None:
    stream = io.StringIO()
    assert verdict({**GOOD, name: value}, Story(stream)) == 1
    assert stream.getvalue().count("NOT SHOWN: ") == (1 if name != "holds" else 2)


def test_how_fast_the_computer_was_is_said_and_is_no_failure() -> None:
    slow = {"fps": 0.93, "fps_aimed_at": 1.0, "latency_ms_p50": 1234.0, "speed": 0.55, "slowed_down": 2}
    assert about_the_computer(slow) == (
        "This computer judged 0.9 pictures a second of 1 aimed at, and the ground heard of each 1.2 s after "
        "it was taken; the rover drove at 0.55 m/s. It became too busy, and drove slower, 2 times."
    )
    assert missing({**GOOD, **slow}) == []


def told(event: dict[str, Any]) -> str:
    """The line of an event, "" for none."""
    stream = io.StringIO()
    story = Story(stream)
    story.where = "meadow 3 m"
    story.event(event, 12.34)
    return stream.getvalue().rstrip("\n").removeprefix("  12.3 s  meadow 3 m     ")


@pytest.mark.parametrize(
    ("event", "line"),
    [
        (
            call(),
            "CALL 3: something here fits none of its words"
            " (uncertainty 0.25, worst tile 0.90, similarity 0.97, frame 41)",
        ),
        (
            call(roi_uncertainty=None, worst_tile=None, similarity=None, reasons=["unknown_scene"]),
            "CALL 3: this place looks like none that it was told about (no figures, frame 41)",
        ),
        (call(kind="hold", reasons=["fault"]), "HOLD 3: it cannot see"),
        (call(kind="hold", reasons=[]), "HOLD 3: not OK"),
        (call(event="call_changed", stage="clear"), "3: the way is clear now; it asks for a go"),
        (call(event="call_changed", stage="answered"), ""),
        (
            {"event": "closed", "kind": "call", "id": 3, "outcome": "taken_over"},
            "call 3 is closed: taken over",
        ),
        ({"event": "closed", "kind": "hold", "id": 3, "outcome": "answered"}, ""),
        ({"event": "ack", "result": "not_covered", "text": "C3 open"}, "answer not covered: C3 open"),
        (
            {"event": "text", "text": "Known place again: words of C2"},
            "no call: Known place again: words of C2",
        ),
        ({"event": "text", "text": "C3 holding"}, ""),
        ({"event": "state", "state": "blocked"}, "state BLOCKED: what it knows here is not drivable"),
        ({"event": "state", "state": "ok"}, ""),
        ({"event": "summary"}, ""),
        ({}, ""),
    ],
)
def test_a_newcomer_reads_what_matters_in_a_line(event: dict[str, Any], line: str) -> None:
    assert told(event) == line


def test_a_change_of_mode_is_told_once_with_who_did_it() -> None:
    stream = io.StringIO()
    story = Story(stream)
    status = {"zone": "forest", "distance": 41.6, "mode": "HOLD", "speed": 0.04} | {
        "mode_log": [{"mode": "HOLD", "by": "companion"}],
        "contacts": [],
    }
    story.field(status, 3.0)
    story.field(status, 4.0)
    assert stream.getvalue() == "   3.0 s  forest 42 m    rover: HOLD (by companion), 0.0 m/s\n"


def test_what_is_driven_into_is_told_once() -> None:
    stream = io.StringIO()
    story = Story(stream)
    status = {"zone": "forest", "distance": 41.6, "mode": "", "speed": 0.04, "mode_log": []} | {
        "contacts": [{"kind": "drum", "speed": 1.25}]
    }
    story.field(status, 3.0)
    story.field(status, 4.0)
    assert stream.getvalue() == "   3.0 s  forest 42 m    THE ROVER DROVE INTO THE DRUM, 1.2 m/s\n"


def test_the_demo_of_guiding_shows_what_is_driven_round_and_what_is_asked_about() -> None:
    shown = {
        "driven_round": 1,
        "things": 1,
        "kept_off_named_things": 1,
        "collisions": 0,
        "hold_refused": "",
    }
    assert missing_guided(shown) == []
    assert missing_guided({**shown, "driven_round": 0}) == ["something that is driven round"]
    assert len(missing_guided({**shown, "things": 0, "collisions": 1, "hold_refused": "too slow"})) == 3


def test_a_story_that_is_quiet_for_long_says_what_it_does_and_nothing_while_a_person_types() -> None:
    stream = io.StringIO()
    story = Story(stream)
    story.plain("begin")
    said = story.began
    story.tick(said + QUIET - 1)
    story.tick(said + QUIET + 1)
    story.doing = "the daemon starts"
    story.tick(said + QUIET - 1)
    assert stream.getvalue() == "begin\n"
    story.tick(said + QUIET + 1)
    assert stream.getvalue().endswith("the daemon starts\n")


def test_a_thread_says_it_while_the_demo_itself_waits(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(story_module, "QUIET", 0.0)
    monkeypatch.setattr(story_module, "_LOOKS", 0.001)
    stream = io.StringIO()
    story = Story(stream)
    story.doing = "the daemon starts"
    with story.signs_of_life():
        wait_for(lambda: "the daemon starts" in stream.getvalue())
