"""When a thing counts as noticed, which cut-outs there are, and that a sweep judges what was encoded."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from anytraverse.assessment import Assessment, Finding, Reason
from anytraverse.evaluation.datasets import LabelledFrame
from anytraverse.frame import Frame, Image
from anytraverse.perception import Perceiver, make_perceiver
from anytraverse.perception.runtime import Runtime
from anytraverse.preferences import Preferences
from bench.perception.approaches import DISTANCES, Approach, approaches, measure_approaches, missed
from bench.perception.frames import Frames, LabelledSet
from bench.perception.judged import Judge, changed
from bench.perception.pasting import Cutout
from bench.perception.sweep import sweep, table
from bench.perception.taps import TAPPED, measure_taps
from bench.perception.things import KINDS, LARGE, SMALL, gather, photographs_in, regions
from companion.sim.field.render import Camera
from companion.sim.field.things import World

FRAME = Frame(1, 0.0, np.zeros((2, 2, 3), dtype=np.uint8))


def judged(ok: bool) -> Assessment:
    finding = Finding(Reason.UNKNOWN_OBJECT, "worst_tile", bad=not ok, clear=ok)
    return Assessment(FRAME, Preferences.parse("grass: 1"), (finding,), 0.0)


def driven(pattern: str, *, clean: bool = True, kind: str = "rock", place: str = "home") -> Approach:
    """Make an approach; in the pattern an x is a frame that is not OK."""
    return Approach(place, kind, "made", judged(clean), [judged(letter != "x") for letter in pattern])


@pytest.mark.parametrize(
    ("pattern", "index"),
    [("xx", 1), (".x.x", 3), (".x..x", None), ("........x", None), (".......xx", 8), (".........", None)],
)
def test_a_thing_is_noticed_by_two_of_three_frames_in_a_row(pattern: str, index: int | None) -> None:
    assert driven(pattern).noticed_at() == (None if index is None else DISTANCES[index])


def test_distances_end_where_a_rover_of_1_m_s_just_stops() -> None:
    assert DISTANCES[0] == pytest.approx(10.0)
    assert DISTANCES[-1] == pytest.approx(2.8)
    assert list(DISTANCES) == sorted(DISTANCES, reverse=True)


def test_what_a_clean_frame_calls_for_is_not_counted() -> None:
    ways = [
        driven("xx"),
        driven("...."),
        driven("xx", clean=False),
        driven("..", kind="person", place="abroad"),
    ]
    figures = measure_approaches(ways)
    assert (figures[f"never noticed, home: {SMALL}"].count, figures[f"never noticed, home: {SMALL}"].of) == (
        1,
        2,
    )
    assert figures[f"never noticed, abroad: {LARGE}"].value == 1.0
    assert missed(ways, SMALL).value == 0.5


def test_photographs_are_read_by_kind_as_rgba(tmp_path: Path) -> None:
    blue = np.zeros((4, 6, 4), dtype=np.uint8)
    blue[..., (0, 3)] = 255
    for kind in ("person", "ghost"):
        (tmp_path / kind).mkdir()
        cv2.imwrite(str(tmp_path / kind / "one.png"), blue)
    cv2.imwrite(str(tmp_path / "person/opaque.png"), blue[..., :3])
    found = photographs_in(tmp_path)
    assert list(found) == ["person"]
    assert len(found["person"]) == 1
    assert tuple(found["person"][0][0, 0]) == (0, 0, 255, 255)


def test_without_photographs_made_things_are_left_and_the_seed_makes_them() -> None:
    one, again, other = (gather(None, [], seed) for seed in (1, 1, 2))
    assert {kind for kind, pictures in one.items() if not pictures} == {
        "person",
        "vehicle",
        "animal",
        "thing",
    }
    for kind in ("wall", "tarp", "rock", "log", "barrel"):
        for left, right in zip(one[kind], again[kind], strict=True):
            assert (left.picture == right.picture).all()
            assert left.height == KINDS[kind].height
    assert (one["wall"][1].picture != other["wall"][1].picture).any()


def test_a_region_is_the_largest_one_and_a_log_lies_across() -> None:
    labels = np.zeros((100, 200), dtype=np.uint8)
    labels[10:40, 20:120] = 1
    labels[60:80, 20:40] = 1
    image = np.zeros((100, 200, 3), dtype=np.uint8)
    across = LabelledSet("a", (LabelledFrame(1, "1", image, labels),), ("dirt", "log"), 255)
    upright = LabelledSet(
        "b", (LabelledFrame(1, "1", image[:, :100], labels.T[:100, :100]),), ("dirt", "log"), 255
    )
    assert [one.shape for one in regions([across, upright], "log", 1.5)] == [(30, 100, 4)]


@pytest.fixture(scope="module")
def trail() -> Image:
    """A picture of the trail, with nothing on it."""
    world = World(31, ())
    return Camera(world, 320, 240).render(world.trail.pose(world.trail.start + 5.0), 0.0)[0]


@pytest.fixture(scope="module")
def perceiver() -> Perceiver:
    return make_perceiver("builtin", Runtime(threads=1))


def test_a_frame_judged_again_is_judged_the_same_without_the_picture(
    perceiver: Perceiver, trail: Image
) -> None:
    judge = Judge.of(perceiver)
    seen = judge.see(trail)
    assert seen.observation is not None
    assert seen.observation.features is None
    assert seen.observation.frame.image.strides == (0, 0, 0)
    again = judge.again(seen.observation)
    assert again.findings == seen.findings
    assert again.roi == seen.roi


def test_a_sweep_judges_frames_again_with_every_setting(perceiver: Perceiver, trail: Image) -> None:
    labels = np.zeros(trail.shape[:2], dtype=np.uint8)
    home = LabelledSet("home", (LabelledFrame(1, "1", trail, labels),), ("dirt",), 255)
    judge = Judge.of(perceiver)
    lenient = judge.with_settings(changed(judge.settings, 0.25, 1.0))
    cutouts = {
        **{kind: list[Cutout]() for kind in KINDS},
        "wall": gather(None, [], 1)["wall"],
        "barrel": gather(None, [], 1)["barrel"],
    }
    ways = list(approaches(lenient, Frames((home,), (), home), cutouts, 2, 1, whole=True))
    assert [one.kind for one in ways] == ["barrel"] * 2 + ["wall"] * 2
    assert all(len(one.frames) == len(one.covered) == len(DISTANCES) for one in ways)
    clean = {"home": [judge.see(trail)]}
    points = sweep(judge, clean, ways)
    assert len(points) == len(table(points).splitlines()) - 2
    strict = [
        point.seen["20% to 100% of the ROI"].value or 0.0 for point in points if point.tile_share == 0.08
    ]
    assert strict == sorted(strict, reverse=True)
    assert strict[0] > 0.5


def test_a_tapped_thing_is_covered_on_the_way_and_another_one_still_calls(
    perceiver: Perceiver, trail: Image
) -> None:
    labels = np.zeros(trail.shape[:2], dtype=np.uint8)
    home = LabelledSet("home", (LabelledFrame(1, "1", trail, labels),), ("dirt",), 255)
    pictures = gather(None, [], 1)
    cutouts = {kind: pictures[kind] if kind in {"barrel", "wall"} else [] for kind in KINDS}
    figures = measure_taps(Judge.of(perceiver), Frames((home,), (), home), cutouts, 1)
    covered, once, other, stopped = (figures[f"{name}: home"] for name in TAPPED)
    assert once.of == stopped.of == 2
    assert covered.of >= once.of
    assert (covered.value or 0.0) > 0.5
    assert other.of > 0
    assert (other.value or 0.0) < 0.5
    assert stopped.count == 0
