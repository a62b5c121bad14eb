"""The clients that users copy, on a link that loses frames and acknowledgements."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path
from random import Random
from typing import Any

import pytest

DOCS = Path(__file__).parents[2] / "docs"
SAMPLES = {"answer_from_python.py": "udpout:", "answer_from_mavsdk.py": "udpout://"}
COMMAND_ACK, PARAM_VALUE, COMPANION = 77, 22, 191
LOST = "no acknowledgement: it may have arrived"


def kind(frame: bytes) -> tuple[int, int]:
    """Sender's component and message id of a MAVLink 2 frame."""
    return (frame[6], int.from_bytes(frame[7:10], "little")) if len(frame) > 9 else (0, 0)


def test_each_sample_is_tried() -> None:
    assert {one.name for one in DOCS.glob("*.py")} == set(SAMPLES)


@pytest.fixture(params=SAMPLES)
def sample(
    request: pytest.FixtureRequest, lossy: Any, start: Callable[..., Any]
) -> Iterator[tuple[str, Any]]:
    """One of the samples on the link, which hears the rover alone."""
    lossy.loses = lambda _: False
    running = start(str(DOCS / request.param), f"{SAMPLES[request.param]}127.0.0.1:{lossy.port}")
    running.wait_for("type go, stay, look")
    yield request.param, running
    running.close()


def test_a_sample_says_of_a_lost_acknowledgement_that_the_answer_may_have_arrived(
    sample: tuple[str, Any], lossy: Any
) -> None:
    name, client = sample
    python = name == "answer_from_python.py"
    command, setting = ("command stay", "set AT_W_GRASS 0.5") if python else ("stay", "AT_W_GRASS 0.5")
    denied = "MAV_RESULT 2" if python else "stay: denied"
    client.ask_until(command, denied, every=5.0)
    lossy.lost = 0
    lossy.loses = lambda frame: kind(frame) in ((COMPANION, COMMAND_ACK), (COMPANION, PARAM_VALUE))
    client.ask(command, LOST)
    assert lossy.lost > 1, "it is sent again"
    client.ask(setting, LOST)
    lossy.loses = lambda _: False
    client.ask_until(command, denied, every=5.0)
    client.ask_until(setting, "AT_W_GRASS = 0.5", every=5.0)


def test_a_sample_answers_a_call_where_three_frames_of_ten_are_lost(
    sample: tuple[str, Any], stage: Any, lossy: Any
) -> None:
    name, client = sample
    chance = Random(name)
    lossy.loses = lambda _: chance.random() < 0.3
    stage.control.start()
    done = "'result': 'applied'" if name == "answer_from_python.py" else "stay: done"
    client.ask_until("stay", done, every=6.0)
