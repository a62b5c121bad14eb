"""The demo on a slow or busy computer, in virtual time: it drives as fast as the computer can judge."""

from __future__ import annotations

import io
import re
from collections.abc import Callable
from pathlib import Path
from typing import Any, cast

import pytest

from anytraverse.perception import make_perceiver
from companion.config import load_config
from companion.daemon.policy.hold_gate import GUIDES_FROM, HoldConditions, HoldGate
from companion.sim.demo.child import ChildError
from companion.sim.demo.config import write_config
from companion.sim.demo.director import Director, allowed
from companion.sim.demo.onlooker import Shown
from companion.sim.demo.pace import PACES, SPEED, DemoPace, Judging, JudgingMeter, pace_for, slower
from companion.sim.demo.readiness import Readiness
from companion.sim.demo.stage import DemoSetup, DemoStage
from companion.sim.demo.story import Story
from companion.vision.warm_up import judging_settings


class Clock:
    """A virtual time in s."""

    now = 100.0

    def sleep(self, seconds: float) -> None:
        self.now += seconds


class SlowDaemon:
    """A daemon whose computer judges `able(t)` pictures/s; hold is refused as the real gate refuses it."""

    running = True

    def __init__(self, clock: Clock, pace: DemoPace, able: Callable[[float], float], out: Path) -> None:
        self.log = out / "daemon.log"
        self.log.write_text("hold cannot be given: it drives too fast: drive at most 1.03 m/s\n")
        self._clock, self._pace, self._able = clock, pace, able
        self._ready_at = clock.now + 3.0
        self._frames, self._last = 0.0, self._ready_at
        path = write_config(
            out,
            camera="field:127.0.0.1:1",
            link="udpout:127.0.0.1:14550",
            policy="hold",
            speed=pace.speed,
            rate=pace.rate,
            freshness=pace.freshness,
        )
        config = load_config(str(path))
        self._gate, self._settings = HoldGate(config), judging_settings(config, make_perceiver("builtin"))

    def error(self, what: str) -> ChildError:
        return ChildError(f"daemon {what}")

    def stop(self) -> None:
        self.running = False

    def status(self) -> dict[str, Any]:
        now = self._clock.now
        if now < self._ready_at:
            return {}
        while self._last + 1.0 <= now:  # it is written once a second
            self._last += 1.0
            self._frames += min(self._pace.rate, self._able(self._last))
        step = 0.6 / self._able(self._last)
        refusal = self._gate.refuses(HoldConditions(self._settings, step))
        return {
            "state": "ok",
            "frames": int(self._frames),
            "latency_ms": 1000 * step,
            "hold_refused": "" if refusal is None else refusal.short,
        }


class Operator:
    """An operator of whom nothing is heard."""

    running = True

    def lines(self) -> list[tuple[float, str]]:
        return []


class SlowStage:
    """As much of a stage as readiness is waited for with."""

    def __init__(self, clock: Clock, able: Callable[[float], float], out: Path) -> None:
        self.setup = DemoSetup("", "", guide=False, console=False, record=False)
        self.control, self.operator = None, Operator()
        self.paces: list[DemoPace] = []
        self._made: Callable[[DemoPace], SlowDaemon] = lambda pace: SlowDaemon(clock, pace, able, out)
        self.change_pace(PACES[0])

    def change_pace(self, pace: DemoPace) -> None:
        self.pace = pace
        self.paces.append(pace)
        self.daemon = self._made(pace)

    @property
    def speed(self) -> float:
        return self.pace.speed

    def daemon_status(self) -> dict[str, Any]:
        return self.daemon.status()


def made_ready(able: Callable[[float], float], out: Path) -> tuple[SlowStage, str, Readiness, Clock]:
    """A stage after `get_ready`, and what was told."""
    clock, told = Clock(), io.StringIO()
    stage = SlowStage(clock, able, out)
    readiness = Readiness(cast(DemoStage, stage), Story(told), lambda: clock.now, clock.sleep)
    readiness.get_ready()
    return stage, told.getvalue(), readiness, clock


@pytest.mark.slow
@pytest.mark.parametrize(("able", "pace"), [(14, 0), (7, 1), (4, 2), (1.6, 3), (0.8, 4)])
def test_the_rover_drives_as_fast_as_the_computer_judges_and_hold_is_given(
    tmp_path: Path, able: float, pace: int
) -> None:
    stage, told, readiness, _ = made_ready(lambda _: able, tmp_path)
    assert stage.pace is PACES[pace]
    assert readiness.refused == ""
    measured = re.search(r"This computer judges ([0-9.]+) pictures a second", told)
    assert measured is not None
    assert float(measured[1]) == pytest.approx(min(10.0, able), abs=0.4)
    assert f"the rover drives at {PACES[pace].speed:g} m/s" in told


def test_a_fast_computer_loses_no_more_than_a_few_seconds_by_being_measured(tmp_path: Path) -> None:
    *_, clock = made_ready(lambda _: 14.0, tmp_path)
    assert clock.now - Clock.now <= 3.0 + 5.0


def test_one_that_was_busy_only_while_all_was_starting_counts_as_fast(tmp_path: Path) -> None:
    stage, *_ = made_ready(lambda at: 3.0 if at < Clock.now + 7.0 else 14.0, tmp_path)
    assert stage.pace is PACES[0]


def test_where_hold_is_refused_the_story_says_why_and_which_speed_would_do(tmp_path: Path) -> None:
    able = [14.0]
    clock, told = Clock(), io.StringIO()
    stage = SlowStage(clock, lambda _: able[0], tmp_path)
    readiness = Readiness(cast(DemoStage, stage), Story(told), lambda: clock.now, clock.sleep)
    readiness.get_ready()
    able[0] = 0.8  # it becomes busy
    clock.sleep(10.0)
    readiness.wait_at_pace(driving=True)
    assert stage.paces == [PACES[0], PACES[2]]
    assert re.search(r"Policy hold is refused at 1.5 m/s. HOLD refused: 0.[78] s a frame", told.getvalue())
    assert "drive at most 1.03 m/s. So the rover drives at 0.8 m/s" in told.getvalue()


def test_one_that_is_too_slow_for_any_pace_ends_the_demo_with_the_reason(tmp_path: Path) -> None:
    with pytest.raises(ChildError, match=r"cannot hold .*a frame"):
        made_ready(lambda _: 0.1, tmp_path)


def test_a_daemon_that_knows_nothing_of_what_it_sees_or_judges_nothing_ends_the_demo(tmp_path: Path) -> None:
    clock = Clock()
    stage = SlowStage(clock, lambda _: 14.0, tmp_path)
    readiness = Readiness(cast(DemoStage, stage), Story(io.StringIO()), lambda: clock.now, clock.sleep)
    blind = stage.daemon_status
    stage.daemon_status = lambda: {**blind(), "state": "fault"}  # type: ignore[method-assign]
    with pytest.raises(ChildError, match="saw nothing that it knows"):
        readiness.get_ready()
    stage.daemon_status = dict  # type: ignore[method-assign]
    readiness = Readiness(cast(DemoStage, stage), Story(io.StringIO()), lambda: clock.now, clock.sleep)
    with pytest.raises(ChildError, match="judged no picture"):
        readiness.get_ready()


def test_a_person_who_quits_while_all_is_loaded_is_not_kept_waiting(tmp_path: Path) -> None:
    clock = Clock()
    stage = SlowStage(clock, lambda _: 14.0, tmp_path)
    stage.operator.running = False
    Readiness(cast(DemoStage, stage), Story(io.StringIO()), lambda: clock.now, clock.sleep).get_ready()
    assert clock.now == Clock.now


def test_the_meter_counts_by_time_and_a_daemon_that_judges_nothing_more_becomes_slower() -> None:
    meter = JudgingMeter()
    assert meter.judging(0.0) is None
    for second in range(6):
        meter.take({"frames": 10 + 4 * second, "latency_ms": 250.0}, float(second))
    assert meter.judging(5.0) == Judging(4.0, 0.25)
    assert cast(Judging, meter.judging(11.0)).rate < 2.0
    meter.take({"frames": 2}, 12.0)
    assert meter.judging(12.0) is None, "it was started again"
    assert meter.began == 12.0


def test_paces_fall_and_the_next_one_is_skipped_where_the_computer_is_known_to_be_slower() -> None:
    assert [pace.speed for pace in PACES] == sorted({pace.speed for pace in PACES}, reverse=True)
    assert PACES[0].speed == SPEED
    assert slower(PACES[1], None) is PACES[2]
    assert slower(PACES[1], Judging(3.9, 0.3)) is PACES[2]
    assert slower(PACES[1], Judging(0.1, 9.9)) is PACES[3], "which may have been a moment"
    assert slower(PACES[4], Judging(0.1, 9.0)) is None
    assert pace_for(Judging(9.9, 3.0)) is PACES[4], "late pictures are as bad as few"
    assert pace_for(Judging(0.4, 3.0), guide=True) is PACES[1], "guide is refused at the slower ones"
    assert slower(PACES[0], Judging(0.1, 9.9), guide=True) is PACES[1]
    assert slower(PACES[1], Judging(0.1, 9.9), guide=True) is None
    assert allowed(PACES[4], 0.3) > 4 * allowed(PACES[0], SPEED)


@pytest.mark.slow
@pytest.mark.parametrize("pace", PACES)
@pytest.mark.parametrize("guide", [False, True])
def test_at_each_pace_the_rover_stops_in_time(tmp_path: Path, pace: DemoPace, guide: bool) -> None:
    path = write_config(
        tmp_path,
        camera="field:127.0.0.1:1",
        link="udpout:127.0.0.1:14550",
        policy="guide" if guide else "hold",
        speed=pace.drives(guide=guide),
        rate=pace.rate,
        freshness=pace.freshness,
        guide=guide,
    )
    config = load_config(str(path))
    step = 0.9 / pace.rate
    now = HoldConditions(judging_settings(config, make_perceiver("builtin")), step, guides=guide)
    refused = HoldGate(config).refuses(now)
    if guide and pace.rate < GUIDES_FROM:
        assert refused is not None
        assert "needs 4" in refused.why
    else:
        assert refused is None, refused


@pytest.mark.parametrize(("step", "given"), [(0.2, True), (0.25, True), (0.26, False)])
def test_guide_is_given_from_four_judged_pictures_a_second(
    tmp_path: Path, step: float, *, given: bool
) -> None:
    pace = PACES[1]
    path = write_config(
        tmp_path,
        camera="field:127.0.0.1:1",
        link="udpout:127.0.0.1:14550",
        policy="guide",
        speed=0.3,
        rate=10.0,
        freshness=pace.freshness,
        guide=True,
    )
    config = load_config(str(path))
    now = HoldConditions(judging_settings(config, make_perceiver("builtin")), step, guides=True)
    gate = HoldGate(config)
    assert (gate.refuses(now) is None) == given
    assert gate.refuses(now._replace(guides=False)) is None


@pytest.mark.parametrize(("mode", "speed"), [("AUTO", 0.0), ("HOLD", 0.9), ("HOLD", 0.1)])
def test_in_a_fault_the_rover_goes_on_slower_once_it_stands(tmp_path: Path, mode: str, speed: float) -> None:
    clock = Clock()
    stage = SlowStage(clock, lambda _: 14.0, tmp_path)
    told = io.StringIO()
    director = Director(cast(DemoStage, stage), Story(told), auto=True)
    director._readiness = Readiness(cast(DemoStage, stage), Story(told), lambda: clock.now, clock.sleep)
    stage.out = tmp_path  # type: ignore[attr-defined]
    (tmp_path / "logs").mkdir()
    director.status = {"mode": mode, "speed": speed, "distance": 3.0}
    director._handle_event({"event": "state", "state": "fault"}, 0.0)
    assert director._is_to_slow_down() == (mode == "HOLD" and speed < 0.2)
    if director._is_to_slow_down():
        director._slow_down()
        assert stage.paces == [PACES[0], PACES[1]]
        assert "this computer has become busier" in told.getvalue()
        assert not director._is_to_slow_down()


@pytest.mark.parametrize(
    ("then", "rounded"),
    [({}, 1), ({"contacts": [{"id": "drum-1"}]}, 0), ({"mode": "AUTO"}, 1)],
)
def test_a_thing_that_is_passed_in_guided_untouched_is_driven_round(
    tmp_path: Path, then: dict[str, Any], rounded: int
) -> None:
    stage = SlowStage(Clock(), lambda _: 14.0, tmp_path)
    director = Director(cast(DemoStage, stage), Story(io.StringIO()), auto=True)
    drum = {"id": "drum-1", "surprise": True, "distance": 2.0}
    director.status = {
        "mode": "GUIDED",
        "mode_log": [{"mode": "GUIDED", "by": "companion"}],
        "things_ahead": [drum],
        "contacts": [],
    }
    director._watch_detours()
    assert director._tally.driven_round == 0
    director.status = {**director.status, "things_ahead": [], **then}
    director._watch_detours()
    director._watch_detours()
    assert director._tally.driven_round == rounded


def test_a_thing_that_is_passed_in_auto_or_taken_away_is_not_driven_round(tmp_path: Path) -> None:
    stage = SlowStage(Clock(), lambda _: 14.0, tmp_path)
    director = Director(cast(DemoStage, stage), Story(io.StringIO()), auto=True)
    drum = {"id": "drum-1", "surprise": True, "distance": 2.0}
    by = [{"mode": "GUIDED", "by": "companion"}]
    status = {"mode": "AUTO", "mode_log": by, "things_ahead": [drum], "contacts": []}
    for mode, taken_away in (("AUTO", set[str]()), ("GUIDED", {"drum-1"})):
        director._removed = taken_away
        for ahead in ([drum], []):
            director.status = {**status, "mode": mode, "things_ahead": ahead}
            director._watch_detours()
    assert director._tally.driven_round == 0


def test_a_hold_of_the_script_of_which_nobody_is_asked_is_ended_by_hand(tmp_path: Path) -> None:
    stage, modes = SlowStage(Clock(), lambda _: 14.0, tmp_path), list[str]()
    stage.control = type("Hand", (), {"mode": lambda _, mode: modes.append(mode)})()
    director = Director(cast(DemoStage, stage), Story(io.StringIO()), auto=True)
    held = {"mode": "HOLD", "speed": 0.0, "mode_log": [{"mode": "HOLD", "by": "companion"}]}
    director.status = held
    for second in range(60):
        director._end_script_hold(float(second))
    director.status = {**held, "mode_log": [{"mode": "HOLD", "by": "script"}]}
    director._open = {1: {}}
    for second in range(60, 120):
        director._end_script_hold(float(second))
    assert modes == []
    director._open = {}
    for second in range(120, 126):
        director._end_script_hold(float(second))
    assert modes == ["AUTO"]


@pytest.mark.parametrize(("distance", "goes"), [(5.6, True), (4.4, False)])
def test_a_go_is_given_for_a_clear_way_whatever_stands_farther_ahead(
    tmp_path: Path, distance: float, *, goes: bool
) -> None:
    stage, typed = SlowStage(Clock(), lambda _: 14.0, tmp_path), list[str]()
    stage.setup = type("Wide", (), {"guide": True})()
    stage.operator = type("Terminal", (), {"type": lambda _, line: typed.append(line)})()
    stage.control = None
    director = Director(cast(DemoStage, stage), Story(io.StringIO()), auto=True)
    log = {"id": "log-across", "kind": "log", "surprise": True, "distance": distance}
    director.status = {"things_ahead": [log], "distance": 25.0}
    director._shown[2] = Shown("log", "meadow", thing="log-across", surprise=True)
    hold = {"id": 2, "kind": "hold", "stage": "clear", "reasons": [], "worst_tile_box": None}
    for tick in range(20):
        assert director._auto is not None
        director._answer(director._auto, hold, tick / 10)
    assert typed == (["2 go"] if goes else [])
