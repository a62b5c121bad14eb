from __future__ import annotations

import math
from copy import copy
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

pytest.importorskip("cv2", reason="the camera draws with OpenCV")

from companion.sim.field.render import LABELS, PinholeCamera
from companion.sim.field.things import World
from companion.sim.field.trail import TrailPose

DRUM, ROCK, GRASS, TREE, SKY, PUDDLE = (
    LABELS.index(name) for name in ("drum", "rock", "grass", "tree", "sky", "puddle")
)
PATH = {LABELS.index("dirt path"), LABELS.index("gravel")}
WORLD = World(1)


@cache
def _camera() -> PinholeCamera:
    """Looks at WORLD. Nobody changes it."""
    return PinholeCamera(WORLD)


def _another() -> PinholeCamera:
    """The camera in a world of its own, to change things in."""
    camera = copy(_camera())
    camera.world = World(1)
    return camera


def _before(world: World, thing_id: str, distance: float) -> TrailPose:
    thing = world.things[thing_id]
    return world.trail.pose(world.trail.nearest(thing.x, thing.y)[0] - distance)


def _pixel(camera: PinholeCamera, pose: TrailPose, x: float, y: float, z: float = 0.0) -> tuple[int, int]:
    column, row, depth = camera.lens.project(pose, x, y, z)
    assert depth > 0
    return int(row), int(column)


def _beside(pose: TrailPose, ahead: float, left: float) -> tuple[float, float]:
    c, s = math.cos(pose.heading), math.sin(pose.heading)
    return pose.x + ahead * c - left * s, pose.y + ahead * s + left * c


def _middles(zone: str) -> NDArray[np.float64]:
    begin, end = WORLD.trail.borders[zone]
    return np.linspace(begin + 8, end - 14, 6)


def test_a_frame_is_rgb_with_a_known_label_for_every_pixel() -> None:
    frame, labels = _camera().render(WORLD.trail.pose(0), 0.0)
    assert frame.shape == (240, 320, 3)
    assert labels.shape == (240, 320)
    assert frame.dtype == labels.dtype == np.uint8
    assert labels.max() < len(LABELS)


@pytest.mark.parametrize(("width", "height"), [(64, 48), (640, 480), (64, 600), (900, 32)])
def test_frames_come_in_other_sizes(width: int, height: int) -> None:
    frame, labels = PinholeCamera(World(1), width, height).render(WORLD.trail.pose(30), 1.0)
    assert frame.shape == (height, width, 3)
    assert labels.shape == (height, width)


def test_a_frame_of_no_size_is_refused() -> None:
    with pytest.raises(ValueError, match="16 to 4096"):
        PinholeCamera(WORLD, 0, 240)


def test_the_same_seed_pose_and_time_give_the_same_pixels() -> None:
    pose = WORLD.trail.pose(60.0)
    _camera().render(WORLD.trail.pose(0.0), 5.0)
    frame, labels = _camera().render(pose, 12.5)
    again, labels_again = PinholeCamera(World(1)).render(pose, 12.5)
    assert np.array_equal(frame, again)
    assert np.array_equal(labels, labels_again)


def test_time_and_the_cameras_seed_change_noise_and_not_labels() -> None:
    pose = WORLD.trail.pose(60.0)
    frame, labels = _camera().render(pose, 1.0)
    for other, other_labels in (_camera().render(pose, 1.05), PinholeCamera(WORLD, seed=9).render(pose, 1.0)):
        assert np.array_equal(labels, other_labels)
        assert 1 < np.abs(frame[150:].astype(int) - other[150:]).mean() < 30


@pytest.mark.parametrize("seed", range(1, 5))
def test_ground_labels_agree_with_the_route(seed: int) -> None:
    world = World(seed, surprises=())
    camera = PinholeCamera(world)
    on, off = [], []
    for s in np.arange(0, world.trail.length, 4.0):
        pose = world.trail.pose(s)
        _, labels = camera.render(pose, 0.0)
        for row in range(camera.lens.horizon + 12, 236, 6):
            for column in range(4, 320, 12):
                index = row - camera.lens.horizon, column
                x, y = _beside(pose, float(camera.lens.forward[index]), float(camera.lens.left[index]))
                lateral = abs(world.trail.nearest(x, y)[1])
                if 0.55 < lateral < 1.1:
                    on.append(int(labels[row, column]) in PATH)
                elif lateral > 1.95:
                    off.append(int(labels[row, column]) not in PATH)
    assert np.mean(on) > 0.97
    assert np.mean(off) > 0.99


def test_the_path_is_dirt_in_meadow_and_forest_and_gravel_on_gravel() -> None:
    for zone, name in (("meadow", "dirt path"), ("forest", "dirt path"), ("gravel", "gravel")):
        for s in _middles(zone):
            _, labels = _camera().render(WORLD.trail.pose(s), 0.0)
            seen = np.bincount(labels[170:, 100:220].ravel(), minlength=len(LABELS))
            assert seen[LABELS.index(name)] == max(seen[label] for label in PATH), (zone, s)


@pytest.mark.parametrize("thing_id", ["drum-1", "rock-1", "log-1"])
def test_a_surprise_is_labelled_where_it_stands(thing_id: str) -> None:
    thing, pose = WORLD.things[thing_id], _before(WORLD, thing_id, 4.5)
    _, labels = _camera().render(pose, 0.0)
    assert labels[_pixel(_camera(), pose, thing.x, thing.y, thing.height / 2)] == LABELS.index(thing.kind)
    shown = np.argwhere(labels == LABELS.index(thing.kind))
    _, foot, depth = _camera().lens.project(pose, thing.x, thing.y)
    assert abs(shown[:, 0].max() - foot) <= 3
    wide = max(2 * thing.radius, thing.length) * _camera().lens.focal / depth
    assert np.ptp(shown[:, 1]) == pytest.approx(wide, rel=0.12, abs=3)


def test_the_nearer_thing_hides_the_farther_one() -> None:
    camera = _another()
    world, pose = camera.world, camera.world.trail.pose(20.0)
    world.move("drum-1", *_beside(pose, 3.0, 0.0))
    world.move("rock-1", *_beside(pose, 6.0, 0.0))
    _, labels = camera.render(pose, 0.0)
    assert DRUM in labels
    assert ROCK not in labels
    world.move("rock-1", *_beside(pose, 2.0, 0.0))
    _, labels = camera.render(pose, 0.0)
    assert labels[_pixel(camera, pose, *_beside(pose, 2.0, 0.0), 0.2)] == ROCK


def test_a_removed_thing_vanishes_from_picture_and_labels() -> None:
    camera = _another()
    world, pose = camera.world, _before(camera.world, "drum-1", 4.0)
    frame, labels = camera.render(pose, 3.0)
    world.remove("drum-1")
    bare, bare_labels = camera.render(pose, 3.0)
    assert np.count_nonzero(labels == DRUM) > 500
    assert DRUM not in bare_labels
    where = labels == DRUM
    assert np.abs(frame.astype(int) - bare)[where].mean() > 25
    assert np.array_equal(frame[:60], bare[:60])


def test_a_moved_thing_shows_where_it_went() -> None:
    camera = _another()
    world, pose = camera.world, _before(camera.world, "drum-1", 4.0)
    world.move("drum-1", *_beside(pose, 4.0, 1.5))
    _, labels = camera.render(pose, 0.0)
    row, column = _pixel(camera, pose, *_beside(pose, 4.0, 1.5), 0.4)
    assert labels[row, column] == DRUM
    assert column < 100


def test_light_scales_brightness_and_not_labels() -> None:
    camera = _another()
    world, pose = camera.world, camera.world.trail.pose(20.0)
    means, seen = [], []
    for light in (0.4, 0.7, 1.0, 1.6):
        world.light = light
        frame, labels = camera.render(pose, 0.0)
        means.append(float(frame.mean()))
        seen.append(labels)
    assert means == sorted(means)
    assert means[0] < 0.65 * means[2]
    assert means[3] > 1.15 * means[2]
    assert all(np.array_equal(labels, seen[0]) for labels in seen)


def test_the_light_of_the_day_changes_slowly_and_a_little() -> None:
    pose = WORLD.trail.pose(20.0)
    means = np.array([_camera().render(pose, t)[0].mean() for t in range(0, 90, 3)])
    assert 1.05 < means.max() / means.min() < 1.5
    assert np.abs(np.diff(means)).max() / means.mean() < 0.06


def test_the_zones_look_different() -> None:
    sides, sky = {}, {}
    for zone in ("meadow", "forest", "gravel"):
        frames = [_camera().render(WORLD.trail.pose(s), 0.0) for s in _middles(zone)]
        sides[zone] = np.mean([frame[labels == GRASS].mean(axis=0) for frame, labels in frames], axis=0)
        sky[zone] = np.mean([(labels == SKY).mean() for _, labels in frames])
    assert sides["forest"].mean() < 0.6 * min(sides["meadow"].mean(), sides["gravel"].mean())
    assert sides["meadow"][1] > 1.15 * sides["meadow"][0]
    assert sides["gravel"][0] > sides["gravel"][1]
    assert sky["forest"] < 0.4 * min(sky["meadow"], sky["gravel"])


def test_a_second_visit_looks_like_the_first() -> None:
    trail = WORLD.trail
    frame, labels = _camera().render(trail.pose(trail.start), 0.0)
    later, later_labels = _camera().render(trail.pose(trail.start + trail.length), 80.0)
    assert np.mean(labels == later_labels) > 0.999
    ratio = later[120:].mean(axis=(0, 1)) / frame[120:].mean(axis=(0, 1))
    assert np.all(np.abs(ratio - 1) < 0.2)


def test_the_texture_of_the_ground_stays_put_while_the_rover_moves() -> None:
    world = World(1, surprises=())
    camera, pose = PinholeCamera(world), world.trail.pose(100.0)
    nearer = TrailPose(*_beside(pose, 0.4, 0.0), pose.heading)
    first, second = (camera.render(at, 0.0)[0].mean(axis=2) for at in (pose, nearer))
    rng = np.random.default_rng(0)
    spots = [_beside(pose, *at) for at in rng.uniform((2.2, -0.9), (3.0, 0.9), (400, 2))]
    before = np.array([first[_pixel(camera, pose, *spot)] for spot in spots])
    after = np.array([second[_pixel(camera, nearer, *spot)] for spot in spots])
    fixed_to_the_screen = np.array([second[_pixel(camera, pose, *spot)] for spot in spots])
    moved = np.corrcoef(before, after)[0, 1]
    assert moved > 0.5
    assert moved > np.corrcoef(before, fixed_to_the_screen)[0, 1] + 0.25


def test_a_puddle_mirrors_the_sky() -> None:
    world = World(1, surprises=())
    camera, pose = PinholeCamera(world), world.trail.pose(110.0)
    puddle = next(thing for thing in world.things.values() if thing.kind == "puddle")
    world.move(puddle.id, *_beside(pose, 3.0, 0.0))
    frame, labels = camera.render(pose, 0.0)
    water = frame[labels == PUDDLE].mean(axis=0)
    assert np.count_nonzero(labels == PUDDLE) > 500
    assert water[2] > water[0]


def test_trees_close_the_forest_and_open_ground_ends_at_the_horizon() -> None:
    _, labels = _camera().render(WORLD.trail.pose(_middles("forest")[2]), 0.0)
    assert (labels[: _camera().lens.horizon] == TREE).mean() > 0.7
    _, labels = _camera().render(WORLD.trail.pose(WORLD.trail.start), 0.0)
    assert (labels[:40] == SKY).mean() > 0.8
    assert not np.isin(labels[: _camera().lens.horizon], [GRASS, *PATH]).mean() > 0.01


def test_rows_of_the_picture_are_distances_on_the_ground() -> None:
    assert _camera().distance_ahead(_camera().lens.horizon - 1) == math.inf
    distances = [_camera().distance_ahead(row) for row in range(_camera().lens.horizon, 240)]
    assert distances == sorted(distances, reverse=True)
    pose = TrailPose(0.0, 0.0, 0.0)
    _, row, _ = _camera().lens.project(pose, 3.0, 0.0)
    assert _camera().distance_ahead(int(row)) == pytest.approx(3.0, rel=0.03)
