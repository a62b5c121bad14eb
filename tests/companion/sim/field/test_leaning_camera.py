"""The pictures of a rover that leans: where the horizon, the ground and the things on it are in them."""

from __future__ import annotations

import json
import math
from functools import cache
from pathlib import Path

import numpy as np
import pytest

pytest.importorskip("cv2", reason="the camera draws with OpenCV")

from companion.sim.field.lens import HEIGHT, PITCH, SimulatedLens
from companion.sim.field.motion import LEVEL, RoverMotion, Tilt
from companion.sim.field.render import GROUND_KINDS, LABELS, PinholeCamera
from companion.sim.field.things import World
from companion.sim.field.trail import TrailPose

DRUM = LABELS.index("drum")
GROUND = [LABELS.index(name) for name in GROUND_KINDS]
TILTS = [(0, 0), (4, 0), (-5, 0), (0, 6), (0, -9), (3, 5), (-4, -7)]
WORLD = World(1)


@cache
def _camera(k1: float = 0.0) -> PinholeCamera:
    return PinholeCamera(WORLD, k1=k1)


def _tilt(pitch: float, roll: float) -> Tilt:
    return Tilt(math.radians(pitch), math.radians(roll))


def _before_the_drum(metres: float) -> TrailPose:
    drum = WORLD.things["drum-1"]
    return WORLD.trail.pose(WORLD.trail.nearest(drum.x, drum.y)[0] - metres)


@pytest.mark.slow
def test_a_level_rovers_frames_are_as_they_always_were() -> None:
    stored = json.loads(Path(__file__).with_name("level_frames.json").read_text(encoding="utf-8"))
    for s, known in stored.items():
        frame, labels = _camera().render(WORLD.trail.pose(float(s)), float(s))
        blocks = frame.reshape(4, 60, 4, 80, 3).mean(axis=(1, 3))
        # OpenCV's versions and processors differ by a rounding here and there.
        assert np.abs(blocks - known["colours"]).max() < 1
        assert np.abs(np.bincount(labels.ravel(), minlength=len(LABELS)) - known["labels"]).max() < 30


@pytest.mark.slow
def test_a_frame_does_not_depend_on_the_tilt_of_the_one_before() -> None:
    pose = WORLD.trail.pose(40.0)
    camera = PinholeCamera(WORLD)
    frame, labels = camera.render(pose, 1.0)
    leaning, _ = camera.render(pose, 1.0, _tilt(3, 4))
    again, labels_again = camera.render(pose, 1.0)
    assert np.array_equal(frame, again)
    assert np.array_equal(labels, labels_again)
    assert not np.array_equal(frame, leaning)


@pytest.mark.parametrize("pitch", [-6.0, -2.0, 3.0, 8.0])
def test_the_horizon_moves_by_the_focal_length_times_the_tangent_of_the_pitch(pitch: float) -> None:
    lens, pose = _camera().lens, WORLD.trail.pose(WORLD.trail.start)
    _, labels = _camera().render(pose, 0.0, _tilt(pitch, 0))
    ends = np.array([np.flatnonzero(np.isin(labels[:, column], GROUND)).min() for column in range(320)])
    expected = 120 + lens.focal * math.tan(math.radians(pitch) - PITCH)
    assert ends.min() == pytest.approx(expected, abs=2)


@pytest.mark.parametrize("roll", [-8.0, 5.0])
def test_a_rover_whose_right_side_is_down_sees_the_horizon_rise_to_the_right(roll: float) -> None:
    ahead, _ = _camera().view(_tilt(0, roll)).where()
    first = np.argmax(~np.isnan(ahead), axis=0)
    rise = np.polyfit(np.arange(320), first, 1)[0]
    assert math.degrees(math.atan(-rise)) == pytest.approx(roll, abs=0.3)


@pytest.mark.slow
@pytest.mark.parametrize("k1", [0.0, -0.12, 0.2])
@pytest.mark.parametrize(("pitch", "roll"), TILTS)
def test_a_drums_foot_is_where_it_is_projected(pitch: float, roll: float, k1: float) -> None:
    drum, tilt = WORLD.things["drum-1"], _tilt(pitch, roll)
    for metres in (3.0, 4.0, 6.0):
        pose = _before_the_drum(metres)
        _, labels = _camera(k1).render(pose, 0.0, tilt)
        shown = np.argwhere(labels == DRUM)
        for z, end in ((0.0, shown[:, 0].max()), (drum.height, shown[:, 0].min())):
            column, row, _ = _camera(k1).view(tilt).project(pose, drum.x, drum.y, z)
            assert abs(end - row) <= 3 + abs(math.sin(tilt.roll)) * np.ptp(shown[:, 1])
            assert shown[:, 1].min() - 2 < column < shown[:, 1].max() + 2


def test_a_drum_on_a_climb_is_where_the_slope_ahead_puts_it() -> None:
    drum = WORLD.things["drum-1"]
    motion = RoverMotion(WORLD.trail, 1, slopes=math.radians(12), swing=math.radians(3))
    moved = set()
    for metres in np.arange(3.0, 7.0, 0.5):
        pose = _before_the_drum(metres)
        tilt = motion.at(metres, WORLD.trail.nearest(pose.x, pose.y)[0], 2.0).tilt
        _, labels = _camera().render(pose, 0.0, tilt)
        _, row, _ = _camera().view(tilt).project(pose, drum.x, drum.y)
        shown = np.argwhere(labels == DRUM)
        assert abs(shown[:, 0].max() - row) <= 3 + abs(math.sin(tilt.roll)) * np.ptp(shown[:, 1])
        moved.add(round(math.degrees(tilt.pitch)))
    assert len(moved) > 3


@pytest.mark.slow
@pytest.mark.parametrize("k1", [0.0, -0.4, -0.12, 0.2])
@pytest.mark.parametrize(("pitch", "roll"), TILTS)
def test_the_metres_of_a_pixel_are_projected_to_that_pixel(pitch: float, roll: float, k1: float) -> None:
    view = _camera(k1).view(_tilt(pitch, roll))
    ahead, left = view.where()
    for row, column in np.argwhere(ahead < 100)[::997]:
        x, y, _ = view.project(TrailPose(0.0, 0.0, 0.0), float(ahead[row, column]), float(left[row, column]))
        assert (x, y) == pytest.approx((column + 0.5, row + 0.5), abs=0.02)


@pytest.mark.slow
def test_the_ground_is_seen_where_a_rotation_of_the_whole_camera_puts_it() -> None:
    """By the matrix of pitch, roll and mount, and OpenCV's model, in place of the camera's own reckoning."""
    import cv2

    k1, tilt = -0.1, _tilt(4, -7)
    turns = [(1, tilt.pitch), (0, tilt.roll), (1, -PITCH)]
    rotation = np.eye(3)  # of the camera: ahead, right, down
    for axis, angle in turns:
        rotation = rotation @ cv2.Rodrigues(np.eye(3)[axis] * angle)[0]
    points = np.array([(a, r, HEIGHT) for a in (2.0, 3.0, 5.0, 9.0) for r in (-1.5, 0.0, 1.0)])
    seen = (points @ rotation)[:, [1, 2, 0]]
    focal = _camera().lens.focal
    matrix = np.array([[focal, 0, 160], [0, focal, 120], [0, 0, 1]])
    pixels, _ = cv2.projectPoints(seen, np.zeros(3), np.zeros(3), matrix, np.array([k1, 0, 0, 0, 0.0]))
    view = _camera(k1).view(tilt)
    for (ahead, right, _), pixel in zip(points, pixels[:, 0], strict=True):
        assert view.project(TrailPose(0, 0, 0), ahead, -right)[:2] == pytest.approx(tuple(pixel), abs=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("k1", [0.0, -0.12])
def test_the_labels_show_the_path_at_the_metres_of_its_pixels(k1: float) -> None:
    world = World(1, surprises=())
    camera, tilt = PinholeCamera(world, k1=k1), _tilt(2, 6)
    ahead, left = camera.view(tilt).where()
    on, off = [], []
    for s in range(0, 120, 11):
        pose = world.trail.pose(s)
        _, labels = camera.render(pose, 0.0, tilt)
        for row, column in np.argwhere(ahead < 8)[::401]:
            a, b = float(ahead[row, column]), float(left[row, column])
            c, d = math.cos(pose.heading), math.sin(pose.heading)
            lateral = abs(world.trail.nearest(pose.x + a * c - b * d, pose.y + a * d + b * c)[1])
            path = LABELS[labels[row, column]] in ("dirt path", "gravel")
            if 0.55 < lateral < 1.1:
                on.append(path)
            elif lateral > 1.95:
                off.append(not path)
    assert np.mean(on) > 0.97
    assert np.mean(off) > 0.99


def test_pixels_past_the_end_of_a_barrel_see_no_metres() -> None:
    ahead, _ = _camera(-0.4).view().where()
    assert np.isnan(ahead[239, [0, 319]]).all()
    assert math.isnan(_camera(-0.4).view().project(TrailPose(0, 0, 0), 2.0, 4.0)[0])
    assert not np.isnan(ahead[200, 160])


def test_rows_of_a_distorted_picture_are_distances_in_its_middle() -> None:
    for row in (130, 180, 230):
        column, at, _ = (
            _camera(-0.12).view().project(TrailPose(0, 0, 0), _camera(-0.12).distance_ahead(row), 0.0)
        )
        assert (column, at) == pytest.approx((160, row + 0.5), abs=0.5)
    assert _camera(-0.12).distance_ahead(10) == math.inf


@pytest.mark.parametrize("tilt", [(45, 0), (-60, 20), (80, 30)])
def test_a_rover_may_look_at_the_sky_or_at_its_feet_alone(tilt: tuple[float, float]) -> None:
    _, labels = _camera().render(WORLD.trail.pose(10.0), 0.0, _tilt(*tilt))
    assert np.isin(labels, GROUND).mean() == pytest.approx(float(tilt[0] < 0), abs=0.01)


def test_a_level_view_is_that_of_the_lens() -> None:
    view, lens = _camera().view(LEVEL), SimulatedLens(320, 240)
    ahead, left = view.where()
    assert np.array_equal(ahead[lens.horizon :], lens.forward)
    assert np.array_equal(left[lens.horizon :], lens.left)
    assert np.isnan(ahead[: lens.horizon]).all()
