"""Field, daemon and operator as real processes over real UDP: from the frame to the answer and back."""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

from companion.sim.demo.child import LoggedProcess
from companion.sim.demo.pace import PACES
from companion.sim.demo.stage import DemoStage, set_stage
from companion.sim.field.trail import Trail
from tests.waiting import wait_for

SEED = 1
TRAIL = Trail(SEED)
DRUM_AHEAD = 12.0
"""m from the start: far enough to be driven up to, nearer than where the trail has it."""
PATIENCE = 60.0
PACE = PACES[2]
"""Slower than the demo's on a quick machine, so that a busy one judges in time."""


class Play:
    """A stage, and what its operator has heard."""

    def __init__(self, stage: DemoStage) -> None:
        self.stage = stage
        self.events: list[dict[str, Any]] = []
        self._read = 0

    def wait_for(self, what: str, fits: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        """The next event that fits; events before it count as read."""

        def fitting() -> dict[str, Any] | None:
            self.events += [json.loads(line) for _, line in self.stage.operator.lines()]
            while self._read < len(self.events):
                self._read += 1
                if fits(self.events[self._read - 1]):
                    return self.events[self._read - 1]
            return None

        return wait_for(fitting, PATIENCE, lambda: self._never(what))

    def wait_until(self, what: str, fits: Callable[[dict[str, Any]], bool]) -> dict[str, Any]:
        """The field's status once it fits."""

        def fitting() -> dict[str, Any] | None:
            status = self.stage.control.status()
            return status if fits(status) else None

        return wait_for(fitting, PATIENCE, lambda: self._never(what))

    def _never(self, what: str) -> str:
        return f"{what} never came; the daemon said:\n{self.stage.daemon.log.read_text()[-2000:]}"

    def drive_to_the_drum(self) -> dict[str, Any]:
        """Start, and come to a stand before the drum; the call."""
        place = TRAIL.pose(TRAIL.start + DRUM_AHEAD)
        self.stage.control.ask("move", id="drum-1", x=place.x, y=place.y)
        self.wait_for("an OK daemon", lambda event: event["event"] == "state" and event["state"] == "ok")
        self.stage.control.start()
        call = self.wait_for("a call", lambda event: event["event"] == "call" and event["kind"] == "call")
        self.wait_until("the hold", lambda status: status["mode"] == "HOLD" and status["speed"] < 0.05)
        return call

    def stand(self) -> float:
        """Metres driven, once the rover has been held in one place for 3 s."""
        deadline, since, at = time.monotonic() + PATIENCE, time.monotonic(), -1.0
        while time.monotonic() < deadline:
            status = self.stage.control.status()
            if status["mode"] != "HOLD" or abs(status["distance"] - at) > 0.3:
                since, at = time.monotonic(), status["distance"]
            elif time.monotonic() - since > 3.0:
                return float(status["distance"])
            time.sleep(0.05)
        raise AssertionError(self._never("its standing"))

    def restart_daemon(self) -> None:
        """Another daemon on the same configuration."""
        daemon = self.stage.daemon
        self.stage.daemon = LoggedProcess(
            "daemon", ["companion", "run", str(self.stage.out / "companion.toml")], daemon.log
        )


@pytest.fixture
def play(tmp_path: Path) -> Iterator[Play]:
    with closing(set_stage(tmp_path, seed=SEED, auto=True, pace=PACE)) as stage:
        yield Play(stage)


def _acknowledged(target: int) -> Callable[[dict[str, Any]], bool]:
    return lambda event: event["event"] == "ack" and event["target"] == target


def test_a_thing_without_a_word_is_called_named_kept_off_and_passed_once_it_is_gone(play: Play) -> None:
    call = play.drive_to_the_drum()
    assert call["reasons"] == ["unknown_object"]
    picture = play.stage.out / "state" / call["picture"].lstrip("/")
    play.wait_until("its picture", lambda _: picture.is_file())
    assert play.stage.control.status()["contacts"] == []

    for _ in range(3):  # a tap on a part of the drum may leave another part unknown: it says so
        play.stage.operator.type(f"{call['id']} tap drum -1 go")
        acknowledgement = play.wait_for("an acknowledgement", _acknowledged(call["id"]))
        if acknowledgement["result"] == "applied":
            break
        assert acknowledgement["result"] == "not_covered"
    assert acknowledgement["result"] == "applied"

    # Called from afar, the way beside it may still be wide enough: then it rolls up to it, and holds there.
    stood_at = play.stand()
    assert play.stage.control.status()["contacts"] == []

    play.stage.control.remove("drum-1")
    deadline = time.monotonic() + PATIENCE
    while play.stage.control.status()["distance"] < stood_at + 4 and time.monotonic() < deadline:
        for number in _open_ids(play):
            play.stage.operator.type(f"{number} go")
        time.sleep(1.0)
    driven = play.wait_until("driving on", lambda status: status["distance"] > stood_at + 4)
    assert driven["contacts"] == []
    assert [entry["by"] for entry in driven["mode_log"][-2:]] == ["companion", "companion"]


def _open_ids(play: Play) -> set[int]:
    play.events += [json.loads(line) for _, line in play.stage.operator.lines()]
    opened = {event["id"] for event in play.events if event["event"] in {"call", "call_changed"}}
    return opened - {event["id"] for event in play.events if event["event"] == "closed"}


def test_a_daemon_killed_with_an_open_call_comes_back_with_it_and_takes_its_answer(play: Play) -> None:
    call = play.drive_to_the_drum()
    play.stage.daemon.process.kill()
    play.stage.daemon.process.wait(5.0)
    assert play.stage.control.status()["mode"] == "HOLD"

    play.wait_for("silence", lambda event: event["event"] == "link" and not event["up"])
    play.restart_daemon()
    play.wait_for(
        "the same call in the heartbeat",
        lambda event: event["event"] == "state" and event["current_id"] == call["id"],
    )
    assert play.stage.control.status()["mode"] == "HOLD", "nothing resumes by a restart"

    play.stage.operator.type(f"{call['id']} tap drum -1")
    acknowledgement = play.wait_for(
        "an acknowledgement", lambda event: _acknowledged(call["id"])(event) and event["result"] != "busy"
    )
    assert acknowledgement["result"] in {"applied", "not_covered"}
    play.stage.daemon.process.kill()
    play.stage.daemon.process.wait(5.0)
    play.restart_daemon()
    words = _status_words(play, after=time.monotonic())
    assert "drum: -1" in words, "an acknowledged word survives kill -9"


def _status_words(play: Play, after: float) -> str:
    path = play.stage.out / "state" / "status.json"
    path.unlink(missing_ok=True)
    while time.monotonic() - after < PATIENCE:
        if path.is_file():
            return str(json.loads(path.read_text())["words"])
        time.sleep(0.1)
    raise AssertionError("the restarted daemon wrote no status")


def test_a_human_who_takes_over_during_a_hold_wins_and_the_call_is_closed(play: Play) -> None:
    call = play.drive_to_the_drum()
    play.stage.control.mode("MANUAL")
    closed = play.wait_for(
        "the end of the call", lambda event: event["event"] == "closed" and event["id"] == call["id"]
    )
    assert closed["outcome"] == "taken_over"
    time.sleep(2.0)
    assert play.stage.control.status()["mode"] == "MANUAL"


def test_a_frozen_camera_holds_the_rover(play: Play) -> None:
    play.wait_for("an OK daemon", lambda event: event["event"] == "state" and event["state"] == "ok")
    play.stage.control.start()
    play.wait_until("driving", lambda status: status["speed"] > 0.8 * PACE.speed)
    play.stage.control.ask("freeze_camera", on=True)
    play.wait_until("the hold", lambda status: status["mode"] == "HOLD" and status["speed"] < 0.05)
    fault = play.wait_for("a fault", lambda event: event["event"] == "state" and event["state"] == "fault")
    assert fault["current_id"] > 0
