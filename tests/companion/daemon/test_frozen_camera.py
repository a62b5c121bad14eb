"""Rule 11: the same picture again is no fresh view while the vehicle moves, and all right while it stands."""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import cv2
import numpy as np
import pytest
from numpy.typing import NDArray
from pymavlink.dialects.v20 import development as mavlink

from anytraverse.frame import Frame
from companion.calls.mode_monitor import ModeReport
from companion.sim.field.render import PinholeCamera
from companion.sim.field.things import World
from companion.vehicle.state import MOVES, is_moving
from companion.vehicle.state import Vehicle as Told
from companion.vision.freeze_detector import (
    CHANGED_REGIONS,
    REMEMBERED,
    FreezeDetector,
    changed_regions,
    luma,
)
from companion.wire.ids import Motion
from tests.companion.daemon.rig import AUTO, HOLD, MANUAL, PERIOD, MakeRig, Rig, picture

Picture = NDArray[np.uint8]

SEQUENCE = Path(__file__).parents[4] / "shared" / "data" / "sequence"


@pytest.fixture(scope="module")
def drive() -> Callable[[float], Picture]:
    """What the simulated rover sees so many metres after its start."""
    world = World(1)
    camera = PinholeCamera(world, 640, 480)
    return lambda metres: camera.render(world.trail.pose(world.trail.start + metres), metres)[0]


def a_picture(value: int = 0) -> Picture:
    image = np.zeros((4, 6, 3), np.uint8)
    image[1:3, 2:5] = value
    return image


def compressed(picture: Picture, quality: int) -> Picture:
    done, content = cv2.imencode(".jpg", picture[..., ::-1], [cv2.IMWRITE_JPEG_QUALITY, quality])
    assert done
    return np.asarray(cv2.imdecode(content, cv2.IMREAD_COLOR), np.uint8)[..., ::-1]


def with_a_clock(picture: Picture, seconds: float) -> Picture:
    shown = picture.copy()
    for colour, width in ((0, 6), (255, 3)):
        text = f"2026-11-22 14:{seconds // 60:02.0f}:{seconds % 60:05.2f}"
        cv2.putText(shown, text, (10, 40), cv2.FONT_HERSHEY_SIMPLEX, 1.2, (colour,) * 3, width)
    return shown


def with_noise(picture: Picture, seed: int, deviation: float = 6.0) -> Picture:
    noise = np.random.default_rng(seed).normal(0.0, deviation, picture.shape)
    return np.asarray(np.clip(picture + noise, 0, 255), np.uint8)


def dimmed(picture: Picture, contrast: float, haze: float) -> Picture:
    return with_noise(np.asarray(picture * contrast + haze, np.uint8), 0, 2.5)


def test_only_time_in_motion_without_any_change_counts() -> None:
    frozen = FreezeDetector()
    assert frozen.seconds(luma(a_picture()), 1.0) == 0.0
    assert frozen.seconds(luma(a_picture()), 0.5) == 0.5
    assert frozen.seconds(luma(a_picture()), 0.0) == 0.5
    assert frozen.seconds(luma(a_picture()), 0.25) == 0.75
    assert frozen.seconds(luma(a_picture(9)), 0.75) == 0.0
    assert frozen.seconds(luma(a_picture(9)), 0.5) == 0.5


@pytest.mark.slow
@pytest.mark.parametrize("buffers", [2, 3, REMEMBERED])
def test_old_pictures_that_come_in_turn_are_no_change(
    drive: Callable[[float], Picture], buffers: int
) -> None:
    frozen = FreezeDetector()
    old = [luma(drive(metres)) for metres in range(buffers)]
    counted = [frozen.seconds(old[number % buffers], 0.1) for number in range(60)]
    assert counted[buffers - 1] == 0.0
    assert counted[-1] == pytest.approx(0.1 * (60 - buffers))


@pytest.mark.slow
@pytest.mark.parametrize("quality", [95, 80, 60, 40])
def test_a_still_picture_with_a_clock_compressed_each_time_anew_is_the_same(
    drive: Callable[[float], Picture], quality: int
) -> None:
    frozen, still = FreezeDetector(), drive(0.0)
    for number in range(20):
        other = quality - 10 * (number % 2)
        seen = luma(compressed(with_a_clock(still, 7.3 * number), other))
        assert frozen.seconds(seen, 0.1) == pytest.approx(0.1 * number)


def test_noise_on_a_still_picture_is_the_same_picture(drive: Callable[[float], Picture]) -> None:
    frozen, still = FreezeDetector(), drive(0.0)
    for number in range(10):
        assert frozen.seconds(luma(with_noise(still, number)), 0.1) == pytest.approx(0.1 * number)


@pytest.mark.slow
@pytest.mark.parametrize(("contrast", "haze"), [(1.0, 0.0), (0.15, 0.0), (0.2, 160.0)], ids=str)
def test_a_rover_that_creeps_sees_another_picture_within_a_second_in_little_light_and_fog(
    drive: Callable[[float], Picture], contrast: float, haze: float
) -> None:
    for start in range(0, 120, 8):
        before, after = (luma(dimmed(drive(metres), contrast, haze)) for metres in (start, start + MOVES))
        assert changed_regions(before, after) >= CHANGED_REGIONS, start


def test_every_frame_of_a_real_drive_is_another_picture() -> None:
    if not SEQUENCE.is_dir():
        pytest.skip(f"{SEQUENCE} is not here")
    frames = [np.asarray(cv2.imread(str(path)), np.uint8) for path in sorted(SEQUENCE.glob("*.jpg"))]
    for before, after in pairwise(frames):
        assert changed_regions(luma(before), luma(after)) > 2 * CHANGED_REGIONS
        assert changed_regions(luma(compressed(before, 60)), luma(compressed(before, 30))) < CHANGED_REGIONS


def test_what_moves_in_a_corner_of_a_still_picture_is_no_motion_of_the_rover() -> None:
    frozen, still = FreezeDetector(), np.full((480, 640, 3), 90, np.uint8)
    waving = still.copy()
    waving[:80, :400] = 200
    frozen.seconds(luma(still), 1.0)
    assert frozen.seconds(luma(waving), 1.0) == 1.0
    waving[:80, :480] = 200
    assert frozen.seconds(luma(waving), 1.0) == 0.0


@pytest.mark.parametrize(
    ("speed", "mode", "moving"),
    [
        (0.0, AUTO, False),
        (0.05, AUTO, False),
        (0.15, AUTO, False),
        (0.5, AUTO, True),
        (0.5, MANUAL, True),
        (None, AUTO, True),
        (None, MANUAL, False),
    ],
)
def test_what_moves_is_what_has_speed_or_else_drives_itself(
    make_rig: MakeRig, speed: float | None, mode: int, moving: bool
) -> None:
    rig = make_rig()
    told = Told(1, 10, mode, armed=True, heard_at=0.0, speed=speed)
    seen = ModeReport(mode, True, None, 0.0, rig.calls.monitor.newest.autopilot)  # noqa: FBT003
    assert is_moving(told, 0.0, drives_itself=seen.drives_itself) is moving


def test_without_a_vehicle_nothing_moves() -> None:
    assert not is_moving(None, 0.0, drives_itself=ModeReport().drives_itself)


@pytest.mark.parametrize(
    ("since", "drives_itself", "moving"),
    [(None, True, False), (9.5, True, False), (9.0, True, True), (1.0, True, True), (1.0, False, False)],
)
def test_a_speed_of_0_is_not_believed_of_one_that_drives_itself_with_throttle(
    since: float | None, drives_itself: bool, moving: bool
) -> None:
    told = Told(1, 10, AUTO, armed=True, heard_at=10.0, speed=0.0, pushes_since=since)
    assert is_moving(told, 10.0, drives_itself=drives_itself) is moving


def freeze(rig: Rig, image: NDArray[np.uint8], seconds: float) -> None:
    """A camera that delivers `image` ten times a second, each as if just taken."""
    for _ in range(round(seconds / PERIOD)):
        rig.frame_id += 1
        rig.step(Frame(rig.frame_id, rig.clock.now + PERIOD - 0.02, image))


def test_a_vehicle_that_may_be_held_is_held_for_a_frozen_camera(make_rig: MakeRig) -> None:
    rig = make_rig()
    assert rig.state == ("OK", 0)
    same = picture()
    freeze(rig, same, 1.0)
    assert rig.state == ("OK", 0)
    freeze(rig, same, 1.0)
    assert rig.stage.mode == 4
    assert rig.state == ("FAULT", 1)
    assert any("camera frozen" in text for text in rig.texts)
    freeze(rig, same, 3.0)
    assert rig.state == ("FAULT", 1)
    rig.see(1.0, scene=90)
    assert rig.state[0] != "FAULT"


def tells(rig: Rig, seconds: float, image: Picture | None, speed: float, throttle: int = 0) -> None:
    """Speed and throttle are told ten times a second, and the camera delivers `image`, if any."""
    for _ in range(round(seconds / PERIOD)):
        place = (0, 470_000_000, 80_000_000, 0, 0, round(100 * speed), 0, 0, 0)
        rig.stage.send(mavlink.MAVLink_global_position_int_message(*place), (1, 1))
        rig.stage.send(mavlink.MAVLink_vfr_hud_message(0.0, speed, 0, throttle, 0.0, 0.0), (1, 1))
        freeze(rig, image, PERIOD) if image is not None else rig.wait(PERIOD)


def test_a_rover_that_stands_with_throttle_in_auto_is_held_for_a_still_picture(make_rig: MakeRig) -> None:
    rig, same = make_rig(), picture()
    tells(rig, 8.0, same, speed=0.0, throttle=9)
    assert rig.state == ("OK", 0)
    tells(rig, 1.0, same, speed=0.0, throttle=30)
    assert rig.state == ("OK", 0)
    tells(rig, 1.5, same, speed=0.0, throttle=30)
    assert rig.stage.mode == HOLD
    assert any("camera frozen" in text for text in rig.texts)
    rig.answer(1, Motion.GO)
    tells(rig, 4.0, same, speed=0.0)
    assert rig.stage.mode == HOLD, "no go ends that"
    assert rig.state[0] == "FAULT"


def test_time_in_which_the_vehicle_stood_and_no_picture_came_does_not_count(make_rig: MakeRig) -> None:
    rig, same = make_rig(), picture()
    rig.stage.mode = MANUAL
    rig.stage.heartbeat(1)
    tells(rig, 1.0, same, speed=0.0)
    tells(rig, 4.0, None, speed=0.0)
    tells(rig, 0.5, same, speed=1.0)
    newest = rig.calls.reason_filter.newest
    assert newest is not None
    assert newest.bad == ()
    tells(rig, 1.0, same, speed=1.0)
    newest = rig.calls.reason_filter.newest
    assert newest is not None
    assert [one.figure for one in newest.bad] == ["camera frozen"]


def test_a_vision_process_that_starts_anew_does_not_make_an_old_picture_new(make_rig: MakeRig) -> None:
    rig = make_rig()
    same = picture()
    freeze(rig, same, 2.0)
    assert rig.state == ("FAULT", 1)
    first = rig.child
    first.death = "SIGSEGV"
    freeze(rig, same, 8.0)
    assert rig.child is not first
    newest = rig.calls.reason_filter.newest
    assert newest is not None
    assert [one.figure for one in newest.bad] == ["camera frozen"]
