"""The trained network on the simulated trail, in worlds that its training never saw."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from numpy.typing import NDArray

from anytraverse.errors import ExampleError
from anytraverse.frame import Image
from anytraverse.perception import Example, Prompt
from anytraverse.perception.builtin.perceiver import SHIPPED, GroundNetwork
from anytraverse.perception.runtime import Runtime
from anytraverse.preferences import Preferences
from anytraverse.regions import Box
from companion.sim.field.render import LABELS, PinholeCamera
from companion.sim.field.things import World, lying_across
from companion.sim.field.trail import LOOP

Labels = NDArray[np.uint8]

WORDS = tuple(Preferences.parse("grass: 1; dirt path: 1; gravel: 1; bush: -1; tree: -1; sky: -0.5"))
DRIVABLE = [LABELS.index(name) for name in LABELS if name in {"grass", "dirt path", "gravel"}]


@pytest.fixture(scope="module")
def network() -> GroundNetwork:
    """The network that ships."""
    return GroundNetwork(SHIPPED, Runtime(threads=1))


@cache
def camera(seed: int) -> PinholeCamera:
    """The camera of a world; painting what it shows takes a second."""
    return PinholeCamera(World(seed), 320, 240)


def before(kind: str, seed: int, distance: float, *, light: float = 1.0) -> tuple[Image, Labels]:
    """What the camera sees `distance` metres before a surprise, and its labels."""
    seen = camera(seed)
    world = seen.world
    world.light = light
    thing = next(each for each in world.things.values() if each.surprise and each.kind == kind)
    along = np.linspace(0.0, world.trail.length, 2000)
    gaps = [math.hypot(thing.x - p.x, thing.y - p.y) for p in map(world.trail.pose, along)]
    place = float(along[int(np.argmin(gaps))]) - distance
    return seen.render(world.trail.pose(place), 0.0)


def thing_box(labels: Labels, kind: str) -> Box:
    """The box around all that is labelled as this kind of thing."""
    rows, columns = np.nonzero(labels == LABELS.index(kind))
    height, width = labels.shape
    left, top = int(columns.min()) / width, int(rows.min()) / height
    return Box(left, top, (int(columns.max()) + 1) / width, (int(rows.max()) + 1) / height)


def parts(values: NDArray[np.float32], labels: Labels, kind: str) -> tuple[float, float]:
    """The mean of a map on the thing, without its rim, and on drivable ground."""
    import cv2

    big = np.asarray(cv2.resize(values, labels.shape[::-1]))
    thing = cv2.erode((labels == LABELS.index(kind)).astype(np.uint8), np.ones((5, 5), np.uint8)) > 0
    return float(big[thing].mean()), float(big[np.isin(labels, DRIVABLE)].mean())


def asked(network: GroundNetwork, image: Image, *more: Prompt) -> NDArray[np.float32]:
    return network.attend(network.encode(image), [*map(Prompt, WORDS), *more])


@pytest.mark.parametrize("kind", ["drum", "rock", "log"])
@pytest.mark.parametrize("light", [0.6, 1.5])
def test_a_thing_without_a_word_is_uncertain_and_the_trail_is_not(
    network: GroundNetwork, kind: str, light: float
) -> None:
    for seed in (31, 32):
        image, labels = before(kind, seed, 4.0, light=light)
        thing, ground = parts(1 - asked(network, image).max(axis=0), labels, kind)
        assert thing > 0.4
        assert ground < 0.2  # with the rim of what lies across the way


@pytest.mark.parametrize("seed", [3, 7, 23])
def test_a_log_that_crosses_the_whole_picture_is_uncertain_and_the_trail_is_not(
    network: GroundNetwork, seed: int
) -> None:
    world = World(seed, course=replace(LOOP, half=2.4))
    at = world.trail.start + 31.0
    world.add(lying_across(world.trail, at))
    seen = PinholeCamera(world, 320, 240, seed)
    things = []
    for distance in (5.0, 4.5, 4.0, 3.5, 3.0):
        image, labels = seen.render(world.trail.pose(at - distance), 0.0)
        thing, ground = parts(1 - asked(network, image).max(axis=0), labels, "log")
        things.append(thing)
        assert ground < 0.1
    assert np.mean(things) > 0.4


@pytest.mark.parametrize("kind", ["drum", "rock", "log"])
def test_a_tapped_thing_is_found_nearer_and_in_other_light(network: GroundNetwork, kind: str) -> None:
    image, labels = before(kind, 31, 4.5)
    example = network.example(network.encode(image), thing_box(labels, kind))
    for distance, light in ((4.5, 1.0), (3.5, 0.7), (3.0, 1.4)):
        image, labels = before(kind, 31, distance, light=light)
        found = asked(network, image, Prompt("named", (example,), drivable=False))[-1]
        thing, ground = parts(found, labels, kind)
        assert thing > 0.6
        assert ground < 0.15


@pytest.mark.parametrize(("tapped", "other"), [("drum", "log"), ("drum", "rock"), ("log", "drum")])
def test_a_tapped_thing_is_not_found_in_another_strange_thing(
    network: GroundNetwork, tapped: str, other: str
) -> None:
    image, labels = before(tapped, 31, 4.0)
    example = network.example(network.encode(image), thing_box(labels, tapped))
    for seed in (31, 32):
        image, labels = before(other, seed, 3.5)
        for drivable in (None, False):
            found = network.attend(network.encode(image), [Prompt("named", (example,), drivable=drivable)])[0]
            assert parts(found, labels, other)[0] < 0.45


@pytest.mark.parametrize("kind", ["drum", "rock", "log"])
def test_a_tapped_danger_covers_all_that_is_strange_about_it(network: GroundNetwork, kind: str) -> None:
    left = []
    for seed in (31, 32, 33, 34):
        image, labels = before(kind, seed, 5.5)
        example = network.example(network.encode(image), thing_box(labels, kind))
        for distance in (5.5, 4.5, 3.5):
            image, labels = before(kind, seed, distance)
            danger = Prompt("named", (example,), drivable=False)
            nothing, some, whole = (
                parts(1 - asked(network, image, *more).max(axis=0), labels, kind)[0]
                for more in ((), (Prompt("named", (example,)),), (danger,))
            )
            assert nothing > 0.45
            assert whole <= some
            assert parts(network.attend(network.encode(image), [danger])[0], labels, kind)[1] < 0.15
            left.append(whole > 0.15)
    assert sum(left) <= 1  # of twelve views one may call again


def test_a_weak_word_that_was_tapped_means_what_was_tapped(network: GroundNetwork) -> None:
    image, labels = before("log", 31, 4.0)
    example = network.example(network.encode(image), thing_box(labels, "log"))
    image, labels = before("rock", 31, 3.5)
    uncertain = 1 - asked(network, image, Prompt("obstacle", (example,))).max(axis=0)
    assert parts(1 - asked(network, image, Prompt("obstacle")).max(axis=0), labels, "rock")[0] < 0.5
    assert parts(uncertain, labels, "rock")[0] > 0.4


def test_several_taps_of_one_word_add_up(network: GroundNetwork) -> None:
    examples = []
    for kind in ("drum", "log"):
        image, labels = before(kind, 31, 4.0)
        examples.append(network.example(network.encode(image), thing_box(labels, kind)))
    both = Prompt("thing", tuple(examples))
    for kind, own in zip(("drum", "log"), examples, strict=True):
        image, labels = before(kind, 31, 3.5)
        seen = network.encode(image)
        alone, together = network.attend(seen, [Prompt("named", (own,)), both])
        assert (together >= alone).all()
        assert parts(together, labels, kind)[0] > 0.5


def test_a_known_word_keeps_what_it_names_beside_its_taps(network: GroundNetwork) -> None:
    image, labels = before("drum", 31, 4.0)
    seen = network.encode(image)
    example = network.example(seen, thing_box(labels, "drum"))
    word, both = (
        network.attend(seen, [Prompt("grass")])[0],
        network.attend(seen, [Prompt("grass", (example,))])[0],
    )
    assert (both >= word).all()
    assert parts(both, labels, "drum")[0] > 0.5


def test_an_example_survives_being_stored_as_bytes(network: GroundNetwork) -> None:
    image, labels = before("drum", 31, 4.0)
    seen = network.encode(image)
    example = network.example(seen, thing_box(labels, "drum"))
    blob = np.ascontiguousarray(example.vector, "<f4").tobytes()
    again = Example(example.model_id, np.frombuffer(blob, "<f4").astype(np.float32))
    one, two = network.attend(seen, [Prompt("drum", (example,)), Prompt("barrel", (again,))])
    np.testing.assert_array_equal(one, two)


def test_a_box_too_small_and_an_example_cut_short_are_refused(network: GroundNetwork) -> None:
    image, labels = before("drum", 31, 4.0)
    seen = network.encode(image)
    with pytest.raises(ExampleError, match="too small"):
        network.example(seen, Box(0.5, 0.5, 0.505, 0.505))
    whole = network.example(seen, thing_box(labels, "drum"))
    short = Example(whole.model_id, whole.vector[:-1])
    with pytest.raises(ExampleError, match="not whole"):
        network.attend(seen, [Prompt("drum", (short,))])


def test_a_box_over_the_whole_picture_teaches_something_finite(network: GroundNetwork) -> None:
    image, _ = before("rock", 31, 4.0)
    example = network.example(network.encode(image), Box(0.0, 0.0, 1.0, 1.0))
    assert example.model_id == network.model_id
    assert example.vector.dtype == np.float32
