"""What a thing was named in the scene most like a call's is offered again, where a thing is asked about."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import pytest

from companion.pages.calls import known_thing, named_thing, nearest
from companion.pages.given import OwnAnswers
from companion.wire.call_report import CallReport, GivenAnswer, NearestScene
from companion.wire.ids import Kind, Reasons, Stage
from tests.companion.link.payloads import CALL


def scene(*operations: str, motion: str = "go", similarity: float = 0.97) -> dict[str, Any]:
    """The answered scene of call 3, in which this was said; two scenes from 0.9 on count as one."""
    given = GivenAnswer(None, None, 0, motion, operations, "applied", "")
    named = named_thing(OwnAnswers(), replace(CALL, id=3, answers=(given,)))
    found = NearestScene(3, similarity, {"drum": -0.5}, "")
    return nearest(found, "you said", motion, 0.9, "", named)


DRUM = "tap drum: -0.5 0.4 0.5 0.6 0.8"


@pytest.mark.parametrize(
    ("motion", "posted", "text"),
    [
        ("go", "go", "−0.5, and go"),
        ("look_again", "look", "−0.5, and look again"),
        ("none", "none", "−0.5"),
        ("", "none", "−0.5"),
    ],
)
def test_it_is_said_again_with_its_motion_and_none_is_made_up(motion: str, posted: str, text: str) -> None:
    known = known_thing(CALL, scene("mud: -1", DRUM, motion=motion))
    assert known is not None
    assert (known["word"], known["weight"], known["motion"]) == ("drum", -0.5, posted)
    assert known["text"] == f"Still the drum you named at C3: {text}"


def test_ground_that_was_named_and_a_scene_that_is_not_alike_offer_nothing() -> None:
    for other in (scene("mud: -1"), scene("tap log: 0.5 0.4 0.5 0.6 0.8"), scene(DRUM, similarity=0.8), None):
        assert known_thing(CALL, other) is None


@pytest.mark.parametrize(
    "call",
    [
        replace(CALL, stage=Stage.CLOSED),
        replace(CALL, stage=Stage.CLEAR),
        replace(CALL, kind=Kind.HOLD),
        replace(CALL, test=True),
        replace(CALL, worst_tile_box=None),
        replace(CALL, reasons=Reasons.UNKNOWN_SCENE),
    ],
)
def test_a_call_that_asks_about_no_thing_offers_nothing(call: CallReport) -> None:
    assert known_thing(CALL, scene(DRUM)) is not None
    assert known_thing(call, scene(DRUM)) is None
