"""The map of the ground from above: served over MAVLink FTP, while the vehicle's pose is known."""

from __future__ import annotations

import time
from typing import cast

import cv2
import numpy as np
import pytest
from pymavlink.dialects.v20 import development as mavlink

from anytraverse.frame import Pose
from companion.daemon import ground_view
from companion.daemon.turn import Turn
from companion.guide.plan import Plan
from companion.storage.served_tree import MissingError
from companion.vision.client import VisionResult
from companion.vision.messages import Planned
from companion.wire.ids import Motion
from tests.companion.daemon.rig import Rig
from tests.companion.daemon.test_faster_than_configured import driving

__all__ = ["driving"]
NAME = "from_above.png"


@pytest.fixture(autouse=True)
def same_clock(driving: Rig, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(time, "monotonic", lambda: driving.clock.now)


def drive(rig: Rig, seconds: float, thing: str = "", speed: int = 80) -> None:
    """Four times a second comes how it stands, and how fast it drives."""
    for _ in range(round(seconds / 0.2)):
        rig.stage.send(mavlink.MAVLink_global_position_int_message(0, 1, 1, 0, 0, speed, 0, 0, 0), (1, 1))
        rig.stage.send(mavlink.MAVLink_attitude_message(0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0), (1, 1))
        rig.see(0.2, thing)


def served(rig: Rig) -> np.ndarray:
    """The map as a ground station fetches it."""
    opened = rig.served.tree.open(f"/maps/{NAME}")
    picture = cv2.imdecode(np.frombuffer(opened.read(0, opened.size), np.uint8), cv2.IMREAD_COLOR)
    assert picture is not None
    return picture[..., ::-1]


def colours(picture: np.ndarray) -> set[tuple[int, ...]]:
    return {tuple(map(int, one)) for one in picture.reshape(-1, 3)}


@pytest.mark.slow
def test_it_shows_what_is_drivable_and_what_no_word_explains(driving: Rig) -> None:
    drive(driving, 3.0)
    assert NAME in {entry.name for entry in driving.served.tree.entries("/maps")}
    assert (102, 197, 171) in colours(served(driving))
    assert (126, 47, 190) not in colours(served(driving))
    drive(driving, 4.0, "drum", speed=0)
    assert (126, 47, 190) in colours(served(driving))
    driving.answer(driving.calls.current_id, Motion.GO)


@pytest.mark.slow
def test_without_a_pose_or_an_age_of_seconds_there_is_none(driving: Rig) -> None:
    driving.see(2.0)
    assert NAME not in {entry.name for entry in driving.served.tree.entries("/maps")}
    drive(driving, 2.0)
    assert served(driving).size
    driving.wait(1.1 * ground_view.FRESH)
    driving.see(0.1)
    with pytest.raises(MissingError):
        served(driving)


@pytest.mark.slow
def test_the_region_and_where_it_stands_are_those_of_the_speed_that_counts(driving: Rig) -> None:
    drive(driving, 3.0)
    shown = served(driving)
    drive(driving, 6.0, speed=140)
    faster = served(driving)

    def top(picture: np.ndarray, colour: tuple[int, int, int]) -> int:
        return int(np.flatnonzero((picture == colour).all(axis=2).any(axis=1))[0])

    for colour in ((255, 255, 255), (200, 30, 30)):
        assert top(faster, colour) < top(shown, colour) - 10


def test_the_way_that_was_planned_is_drawn_while_it_is_new(driving: Rig) -> None:
    drive(driving, 3.0)
    plan = Plan(driving.clock.now, Pose(0.0, 0.0, 0.0), 2.0, arcs=((0.2, 3.0),), clear=3.0)
    event = VisionResult(Planned(plan), driving.vision.memory)
    driving.daemon.ground_view.happened(event, cast(Turn, None))
    assert (0, 72, 186) in colours(served(driving))
    drive(driving, 1.1 * ground_view.FRESH)
    assert (0, 72, 186) not in colours(served(driving))
