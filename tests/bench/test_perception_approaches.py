"""When a thing counts as noticed, what its pictures are, and what a tap covers on the way to it."""

from __future__ import annotations

from pathlib import Path

import cv2
import numpy as np
import pytest

from anytraverse.assessment import Assessment, Finding, Reason
from anytraverse.evaluation.datasets import LabelledFrame
from anytraverse.frame import Frame
from anytraverse.perception import make_perceiver
from anytraverse.perception.runtime import Runtime
from anytraverse.preferences import Preferences
from bench.perception.approaches import DISTANCES, Approach, measure_approaches, missed
from bench.perception.frames import Frames, LabelledSet
from bench.perception.judged import Judge
from bench.perception.taps import TAPPED, measure_taps
from bench.perception.things import KINDS, LARGE, SMALL, gather, photographs_in
from companion.sim.field.render import PinholeCamera
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


def test_a_tapped_thing_is_covered_on_the_way_and_another_one_still_calls() -> None:
    world = World(31, ())
    trail = PinholeCamera(world, 320, 240).render(world.trail.pose(world.trail.start + 5.0), 0.0)[0]
    labels = np.zeros(trail.shape[:2], dtype=np.uint8)
    home = LabelledSet("home", (LabelledFrame(1, "1", trail, labels),), ("dirt",), 255)
    judge, pictures = Judge.of(make_perceiver("builtin", Runtime(threads=1))), gather(None, [], 1)
    cutouts = {kind: pictures[kind] if kind in {"barrel", "wall"} else [] for kind in KINDS}
    figures = measure_taps(judge, Frames((home,), (), home), cutouts, 1)
    covered, once, other, stopped = (figures[f"{name}: home"] for name in TAPPED)
    assert once.of == stopped.of == 2
    assert covered.of >= once.of
    assert (covered.value or 0.0) > 0.5
    assert other.of > 0
    assert (other.value or 0.0) < 0.5
    assert stopped.count == 0
