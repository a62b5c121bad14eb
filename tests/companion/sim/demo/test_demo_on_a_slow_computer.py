"""The demo on a computer that judges too slowly: less often, until hold can be given."""

from __future__ import annotations

import argparse
import io
from pathlib import Path
from typing import Any, cast

import pytest

from anytraverse.perception import make_perceiver
from companion.config import load_config
from companion.daemon.policy.hold_gate import HoldConditions, HoldGate
from companion.sim.demo import director as director_module
from companion.sim.demo import main as module
from companion.sim.demo.child import ChildError
from companion.sim.demo.config import write_config
from companion.sim.demo.director import Director, Stage
from companion.sim.demo.main import PACES, SPEED, DemoPace
from companion.sim.demo.story import Story
from companion.vision.warm_up import judging_settings

SLOW = "HOLD refused: 0.5 s a frame: make it faster"


class Daemon:
    """A daemon with such statuses, one after the other, the last one for ever."""

    running = True

    def error(self, what: str) -> ChildError:
        return ChildError(f"daemon {what}")


class Played:
    """As much of a stage as is waited for."""

    def __init__(self, *statuses: dict[str, Any]) -> None:
        self.daemon, self.control = Daemon(), None
        self._statuses, self.closed = list(statuses), False

    def daemon_status(self) -> dict[str, Any]:
        return self._statuses.pop(0) if len(self._statuses) > 1 else self._statuses[0]

    def close(self) -> None:
        self.closed = True


@pytest.fixture
def _quick(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, seconds in (("READY_WITHIN", 1.0), ("SLOW_FOR", 0.1), ("STEP", 0.01)):
        monkeypatch.setattr(director_module, name, seconds)


def ready(*statuses: dict[str, Any]) -> str:
    """Why the daemon with these statuses may not hold."""
    director = Director(cast(Stage, Played(*statuses)), Story(io.StringIO()), auto=True)
    return director.wait_until_ready()


@pytest.mark.usefixtures("_quick")
def test_it_is_ready_when_it_sees_and_may_hold_and_too_slow_when_that_lasts() -> None:
    fine, slow = {"state": "ok", "hold_refused": ""}, {"state": "ok", "hold_refused": SLOW}
    assert ready({}, fine) == ""
    assert ready({}, slow, slow, fine) == "", "it was slow as it started"
    assert ready({}, slow) == SLOW
    with pytest.raises(ChildError, match="saw nothing that it knows"):
        ready({"state": "fault", "hold_refused": ""})


@pytest.mark.usefixtures("_quick")
def test_it_judges_less_often_until_hold_can_be_given_and_says_so(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[tuple[float, float]] = []
    stages: list[Played] = []

    def set_stage(*_: object, rate: float, speed: float, **__: object) -> Played:
        asked.append((rate, speed))
        stages.append(Played({"state": "ok", "hold_refused": "" if len(asked) == 2 else SLOW}))
        return stages[-1]

    monkeypatch.setattr(module, "set_stage", set_stage)
    monkeypatch.setattr(Director, "play", lambda _: {"calls": 1})
    told = io.StringIO()
    options = argparse.Namespace(seed=1, auto=True, console=False, guide=False)
    assert module._played(options, tmp_path, Story(told)) == {"calls": 1}
    assert asked == [(10.0, SPEED), (4.0, SPEED)]
    assert all(stage.closed for stage in stages)
    assert f"{SLOW}: it judges 4 frames/s and drives 1.5 m/s" in told.getvalue()


@pytest.mark.parametrize(("pace", "step"), [*zip(PACES, (0.4, 0.37, 0.6), strict=True)])
def test_at_each_pace_the_rover_stops_in_time(tmp_path: Path, pace: DemoPace, step: float) -> None:
    path = write_config(
        tmp_path,
        camera="field:127.0.0.1:1",
        link="udpout:127.0.0.1:14550",
        policy="hold",
        speed=pace.speed,
        rate=pace.rate,
    )
    config = load_config(str(path))
    now = HoldConditions(judging_settings(config, make_perceiver("builtin")), step)
    refused = HoldGate(config).refuses(now)
    assert refused is None, refused
