"""A wrong port is silence: the log says what to check."""

from __future__ import annotations

import logging
from types import SimpleNamespace
from typing import Any, cast

import pytest

from companion.calls.machine import OperatorCalls
from companion.calls.numbers import Numbers
from companion.calls.policy import PolicyState
from companion.cameras.newest import CameraStatus
from companion.daemon.health import NO_AUTOPILOT_AFTER, HealthMonitor
from companion.tasks import Liveness, tasks
from companion.vehicle.state import Vehicle
from companion.vision.judging_rate import JudgingRate
from companion.wire.ids import Policy

_VISION = SimpleNamespace(
    trouble="",
    delivered_at=None,
    camera=CameraStatus(),
    watchdog=SimpleNamespace(alive_at=0.0, unreliable=False),
    rate=JudgingRate(10.0, 1.0, 3),
    infrared=None,
)


def _watch(link: Any) -> HealthMonitor:
    numbers = Numbers()
    return HealthMonitor(
        Liveness(tasks(numbers), 0.0),
        link,
        cast(Any, _VISION),
        OperatorCalls(numbers, PolicyState(Policy.REPORT), 0.0),
        cast(Any, SimpleNamespace(failing=False)),
    )


def _link(vehicle: object) -> Any:
    texts = SimpleNamespace(send=lambda *_: None)
    return SimpleNamespace(vehicle=vehicle, trouble=None, stores_timestamps=True, texts=texts)


def test_without_an_autopilot_the_log_says_once_what_to_check(caplog: pytest.LogCaptureFixture) -> None:
    watch = _watch(_link(None))
    with caplog.at_level(logging.WARNING, "companion.daemon.health"):
        for now in (0.0, NO_AUTOPILOT_AFTER - 0.1):
            watch.check(now)
        assert "no autopilot" not in caplog.text
        for now in (NO_AUTOPILOT_AFTER, NO_AUTOPILOT_AFTER + 60):
            watch.check(now)
    assert caplog.text.count("no autopilot heard") == 1
    assert "[link] url" in caplog.text


def test_an_autopilot_that_is_heard_is_no_matter_for_the_log(caplog: pytest.LogCaptureFixture) -> None:
    watch = _watch(_link(Vehicle(1, autopilot=3, custom_mode=0, armed=False, heard_at=0.0, type=10)))
    with caplog.at_level(logging.INFO, "companion.daemon.health"):
        for now in (0.0, NO_AUTOPILOT_AFTER + 1):
            watch.check(now)
    assert "autopilot" not in caplog.text
