"""Rule 6, over whole drives past several things: the rover drives over none that no call was about."""

from __future__ import annotations

from dataclasses import dataclass

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from anytraverse.regions import Box
from companion.wire.ids import Policy
from tests.companion.calls.scenes import AUTO, HEIGHT, WIDTH, Scene, Thing, View

SKY = Thing(Box(0.0, 0.0, 1.0, 0.5), "sky")
ROI = Box(1 / 3, 0.6, 2 / 3, 0.95)
NEAR = 1.0
"""Metres at which a thing is about to be driven over."""
LARGE = 0.01
"""Of the picture: a thing is judged that shows as much in the ROI when it is near: about a tile."""


@dataclass(frozen=True)
class Post:
    """Something that stands on level ground. All in metres: aside is to the right, ahead from the start."""

    aside: float
    ahead: float
    wide: float
    high: float

    def box(self, driven: float) -> Box | None:
        """Where the picture shows it. None where it is passed, or too far away."""
        away = self.ahead - driven
        if away < 0.9:
            return None
        middle, half, base = 0.5 + 0.5 * self.aside / away, 0.25 * self.wide / away, 0.45 + 0.5 / away
        left, right, top = max(0.0, middle - half), min(1.0, middle + half), base - 0.5 * self.high / away
        shows = right - left >= 1 / WIDTH and base - max(0.0, top) >= 1 / HEIGHT
        return Box(left, max(0.0, top), right, min(1.0, base)) if shows else None


def shared(one: Box, other: Box) -> float:
    """The area that two boxes share, as a share of the picture."""
    across = min(one.right, other.right) - max(one.left, other.left)
    return max(0.0, across) * max(0.0, min(one.bottom, other.bottom) - max(one.top, other.top))


def touching(shown: dict[str, Box], box: Box) -> set[str]:
    """What the box shows some of, and what touches that in the picture, or nearly."""
    found: set[str] = set()
    around = [box]
    while around:
        one = around.pop()
        left, top = max(0.0, one.left - 0.07), max(0.0, one.top - 0.07)
        near = Box(left, top, min(1.0, one.right + 0.07), min(1.0, one.bottom + 0.07))
        new = {name for name, other in shown.items() if name not in found and shared(near, other) > 0.0}
        found |= new
        around += [shown[name] for name in new]
    return found


POSTS = st.lists(
    st.tuples(*(st.floats(*ends) for ends in ((-0.9, 0.9), (0.5, 3.0), (0.4, 1.0), (0.8, 1.8)))),
    min_size=2,
    max_size=4,
)


@pytest.mark.slow
@given(POSTS, st.sampled_from([0.25, 0.65]), st.sampled_from([0.5, 1.0, 2.0]), st.integers(3, 25))
@settings(max_examples=25)
@example([(0.58, 0.0, 0.64, 1.68), (-0.23, 1.5, 0.64, 1.48)], 0.65, 1.0, 4)
@example([(-0.69, 0.8, 1.01, 1.38), (0.52, 1.5, 0.48, 1.02)], 0.25, 1.0, 4)
def test_what_no_call_was_about_is_not_driven_over(
    gaps: list[tuple[float, float, float, float]], tile: float, speed: float, frames: int
) -> None:
    posts, ahead = dict[str, Post](), 3.0
    for number, (aside, gap, wide, high) in enumerate(gaps):
        ahead += gap
        posts[str(number)] = Post(aside, ahead, wide, high)
    scene, driven, waited, asked = Scene(Policy.HOLD, tile=tile), 0.0, 0, set[str]()
    scene.run(0.5)
    for _ in range(300):
        shown = {name: box for name, one in reversed(posts.items()) if (box := one.box(driven)) is not None}
        scene.run(0.1, View((SKY, *(Thing(box, name) for name, box in shown.items()))))
        if scene.autopilot.mode == AUTO:
            driven += speed / 10
            under = {name for name, one in posts.items() if NEAR <= one.ahead - driven < NEAR + speed / 10}
            for name in under & (shown.keys() - asked):
                assert shared(shown[name], ROI) < LARGE, f"{name} at {driven} m"
        call = scene.calls.call
        waited = waited + 1 if call is not None and not call.answered else 0
        if call is not None and waited > frames and call.seen is not None and call.seen.tile is not None:
            then = {one.name: one.box for one in scene.frames[call.frame_id].things if one is not SKY}
            asked |= touching(then, call.seen.tile.box)
            scene.go()
        if driven > ahead:
            break
