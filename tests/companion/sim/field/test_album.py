"""What a box of the field's picture truly shows."""

from __future__ import annotations

import math

import numpy as np
import pytest

from anytraverse.regions import Box
from companion.sim.field.album import Album, _outline
from companion.sim.field.control import FieldError
from companion.sim.field.motion import LEVEL, Tilt
from companion.sim.field.render import LABELS, PinholeCamera
from companion.sim.field.things import World
from companion.sim.field.trail import TrailPose
from companion.sim.field.view import View

WIDTH, HEIGHT = 320, 240
REGION = Box(0.35, 0.46, 0.65, 0.95)


class Scene:
    """A world with its camera, and an album of what that has drawn."""

    def __init__(self, kind: str = "drum") -> None:
        self.world = World(0, [kind])
        self.camera = PinholeCamera(self.world, WIDTH, HEIGHT)
        self.album = Album(self.world)
        self.thing = next(thing for thing in self.world.things.values() if thing.surprise)

    def draw(self, metres: float, at: float = 1.0) -> Box:
        """Draw the picture so many metres before the thing; a box of the size of a call's around it."""
        s, _ = self.world.trail.nearest(self.thing.x, self.thing.y)
        pose = self.world.trail.pose(s - metres)
        self.album.keep(at, pose, self.camera.render(pose, 0.0)[1])
        return around(pose, self.thing.x, self.thing.y)


def around(pose: TrailPose, x: float, y: float, tilt: Tilt = LEVEL, k1: float = 0.0) -> Box:
    """A square of 24 pixels with its lower side on the ground at a point."""
    column, row, _ = View(WIDTH, HEIGHT, tilt, k1).project(pose, x, y)
    sides = (column - 12) / WIDTH, (row - 22) / HEIGHT, (column + 12) / WIDTH, (row + 2) / HEIGHT
    return Box(*sides)


@pytest.mark.parametrize("metres", [5.0, 9.3, 10.0, 12.0])
@pytest.mark.parametrize("kind", ["drum", "rock", "log"])
def test_a_thing_in_the_box_is_named_from_as_far_as_it_calls(kind: str, metres: float) -> None:
    scene = Scene(kind)
    seen = scene.album.look(scene.draw(metres), 1.0)
    assert (seen["thing"], seen["kind"], seen["surprise"]) == (f"{kind}-1", kind, True)
    assert (seen["patch"], seen["zone"]) == (None, "meadow")
    if metres > 9.0 and kind != "log":
        assert seen["outline"] is None


@pytest.mark.parametrize("metres", [3.0, 6.0])
def test_a_thing_is_seen_in_the_region_of_interest_too(metres: float) -> None:
    scene = Scene()
    scene.draw(metres)
    assert scene.album.look(REGION, 1.0)["thing"] == "drum-1"


def test_a_corner_of_a_thing_on_the_path_is_enough_and_its_own_box_is_told() -> None:
    scene = Scene()
    box = scene.draw(9.5)
    aside = Box(box.left + 0.03, box.top + 0.06, box.right + 0.03, box.bottom + 0.06)
    seen = scene.album.look(aside, 1.0)
    assert seen["thing"] == "drum-1"
    left, top, right, bottom = seen["outline"]
    assert box.left < left < right < box.right
    assert box.top <= top < bottom <= box.bottom


def test_a_thing_that_is_larger_than_the_box_has_its_outline() -> None:
    scene = Scene("log")
    scene.draw(3.0)
    seen = scene.album.look(Box(0.45, 0.55, 0.5, 0.6), 1.0)
    assert seen["thing"] == "log-1"
    left, _, right, _ = seen["outline"]
    assert right - left > 0.2, "a person frames all of it, not what the box happens to have"


def test_the_outline_is_of_one_thing_where_two_of_a_kind_are_seen() -> None:
    labels = np.zeros((100, 100), np.uint8)
    labels[40:80, 10:30] = labels[40:80, 60:90] = LABELS.index("drum")
    assert _outline(labels, "drum", Box(0.65, 0.5, 0.7, 0.6)) == [0.6, 0.4, 0.9, 0.8]
    assert _outline(labels, "drum", Box(0.05, 0.4, 0.35, 0.8)) is None


def test_a_thing_that_begins_where_the_box_ends_is_what_it_is_about() -> None:
    scene = Scene()
    box = scene.draw(9.5)
    column = (box.left + box.right) / 2 + 6.5 / WIDTH
    beside = Box(column, box.top + 0.02, column + 0.08, box.bottom + 0.02)
    seen = scene.album.look(beside, 1.0)
    assert seen["thing"] == "drum-1"
    assert seen["outline"] is not None


def test_a_box_beside_the_thing_shows_the_ground_that_is_there() -> None:
    scene = Scene()
    scene.draw(9.5)
    seen = scene.album.look(Box(0.4, 0.8, 0.5, 0.9), 1.0)
    assert (seen["thing"], seen["kind"]) == (None, "dirt path")
    assert seen["patch"] == "dirt path, meadow, path"


def test_a_box_above_the_ground_shows_neither() -> None:
    scene = Scene()
    scene.draw(9.5)
    assert scene.album.look(Box(0.4, 0.0, 0.5, 0.1), 1.0)["kind"] == ""


def test_the_picture_of_that_time_is_looked_at() -> None:
    scene = Scene()
    box = scene.draw(9.5, at=1.0)
    scene.draw(3.0, at=4.0)
    assert scene.album.look(box, 1.2)["thing"] == "drum-1"
    assert scene.album.look(Box(0.0, 0.9, 0.1, 1.0), None)["thing"] is None


def test_the_place_is_the_one_that_the_rover_sees_ahead() -> None:
    scene = Scene()
    begin, _ = scene.world.trail.borders["forest"]
    pose = scene.world.trail.pose(begin - 3.0)
    scene.album.keep(1.0, pose, np.zeros((HEIGHT, WIDTH), np.uint8))
    assert scene.album.look(REGION, 1.0)["zone"] == "forest"


def test_a_time_of_which_no_picture_is_kept_is_refused() -> None:
    scene = Scene()
    with pytest.raises(FieldError, match="ask sooner"):
        scene.album.look(REGION, None)
    scene.draw(9.5, at=100.0)
    with pytest.raises(FieldError, match="ask sooner"):
        scene.album.look(REGION, 50.0)


def test_of_two_things_of_a_kind_the_one_in_the_box_is_meant() -> None:
    scene = Scene()
    s, _ = scene.world.trail.nearest(scene.thing.x, scene.thing.y)
    pose = scene.world.trail.pose(s - 6.0)
    other = type(scene.thing)(**{**vars(scene.thing), "id": "drum-2"})
    other.x -= 1.5 * math.sin(pose.heading)
    other.y += 1.5 * math.cos(pose.heading)
    scene.world.things[other.id] = other
    scene.album.keep(1.0, pose, scene.camera.render(pose, 0.0)[1])
    assert scene.album.look(around(pose, other.x, other.y), 1.0)["thing"] == "drum-2"
    assert scene.album.look(around(pose, scene.thing.x, scene.thing.y), 1.0)["thing"] == "drum-1"


def test_of_two_things_the_one_in_the_box_is_meant_in_the_picture_of_a_rover_that_leans() -> None:
    scene, k1, tilt = Scene(), -0.12, Tilt(math.radians(9), math.radians(-12))
    s, _ = scene.world.trail.nearest(scene.thing.x, scene.thing.y)
    pose = scene.world.trail.pose(s - 4.0)
    other = type(scene.thing)(**{**vars(scene.thing), "id": "drum-2"})
    other.x += 3.0 * math.cos(pose.heading) - 0.8 * math.sin(pose.heading)
    other.y += 3.0 * math.sin(pose.heading) + 0.8 * math.cos(pose.heading)
    scene.world.things[other.id] = other
    camera, album = PinholeCamera(scene.world, WIDTH, HEIGHT, k1=k1), Album(scene.world, k1)
    album.keep(1.0, pose, camera.render(pose, 0.0, tilt)[1], tilt)
    for thing in (other, scene.thing):
        assert album.look(around(pose, thing.x, thing.y, tilt, k1), 1.0)["thing"] == thing.id
    path = around(
        pose, pose.x + 2.3 * math.cos(pose.heading), pose.y + 2.3 * math.sin(pose.heading), tilt, k1
    )
    assert album.look(path, 1.0)["patch"] == "dirt path, meadow, path"
