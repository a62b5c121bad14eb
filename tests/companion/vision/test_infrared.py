"""Cameras without an infrared filter: which pictures look so, and when it counts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from anytraverse.evaluation.degrade import degraded, infrared, magenta
from anytraverse.frame import Image
from companion.vision import infrared as rules
from companion.vision.infrared import SHARE, InfraredDetector, magenta_share

_DATA = Path(__file__).parents[4] / "shared" / "data"


def _painted(*colour: int, seed: int = 0) -> Image:
    """A textured surface of one colour."""
    grain = np.random.default_rng(seed).normal(0.0, 12.0, (120, 160, 1))
    return np.clip(np.array(colour) + grain, 0, 255).astype(np.uint8)


def _meadow() -> Image:
    """A bluish sky, bushes, a track and grass."""
    picture = _painted(90, 110, 60)
    picture[:40] = _painted(190, 205, 225)[:40]
    picture[40:60] = _painted(60, 75, 45)[40:60]
    picture[60:, 60:100] = _painted(135, 125, 110)[60:, 60:100]
    return picture


def _share(picture: Image) -> float:
    share = magenta_share(picture)
    assert share is not None
    return share


@pytest.mark.parametrize("strength", [0.5, 1.0, 2.0])
def test_a_meadow_without_an_infrared_filter_is_magenta(strength: float) -> None:
    assert _share(infrared(_meadow(), strength)) >= SHARE


@pytest.mark.parametrize("name", ["cold", "dusk", "jpeg", "shadows", "half-light"])
def test_it_is_so_too_in_other_light(name: str) -> None:
    assert _share(degraded(infrared(_meadow()), name, 1)) >= SHARE


@pytest.mark.parametrize("name", ["cold", "warm", "green", "dusk", "glare", "shadows", "fog", "rain", "jpeg"])
def test_a_meadow_with_a_filter_is_not_in_any_light(name: str) -> None:
    assert _share(_meadow()) < SHARE / 2
    assert _share(degraded(_meadow(), name, 1)) < SHARE / 2


@pytest.mark.parametrize(
    "colour", [(128, 128, 128), (140, 78, 47), (165, 108, 70), (200, 120, 70), (110, 90, 130), (60, 110, 180)]
)
def test_grey_laterite_a_sunset_and_a_blue_sky_are_not_magenta_and_a_lavender_field_is(
    colour: tuple[int, int, int],
) -> None:
    assert (_share(_painted(*colour)) >= SHARE) is (colour == (110, 90, 130))


@pytest.mark.parametrize("level", [0, 10, 255])
def test_a_picture_that_is_dark_or_white_says_nothing(level: int) -> None:
    assert magenta_share(np.full((60, 80, 3), level, np.uint8)) is None


@settings(max_examples=60, deadline=None)
@given(st.integers(1, 100), st.integers(1, 100), st.integers(0, 2**32))
def test_the_share_of_any_picture_is_a_fraction_or_unknown(rows: int, columns: int, seed: int) -> None:
    picture = np.random.default_rng(seed).integers(0, 256, (rows, columns, 3), dtype=np.uint8)
    share = magenta_share(picture)
    assert share is None or 0.0 <= share <= 1.0


def _decided(
    monkeypatch: pytest.MonkeyPatch, looks: Sequence[bool | None], gap: float = 5.0
) -> list[bool | None]:
    """What the detector says after each look."""
    shares = {True: SHARE, False: SHARE - 0.01, None: None}
    monkeypatch.setattr(rules, "magenta_share", lambda look: shares[look])
    detector = InfraredDetector()
    return [detector.check(look, gap * number) for number, look in enumerate(looks, 1)]  # type: ignore[arg-type]


def test_eight_of_ten_looks_say_yes_and_thirty_without_one_say_no(monkeypatch: pytest.MonkeyPatch) -> None:
    told = _decided(monkeypatch, [False, True, True, False, *[True] * 6, *[False] * 30])
    assert told[:9] == [None] * 9
    assert told[9:39] == [True] * 30
    assert told[39:] == [False]


def test_what_comes_and_goes_changes_nothing_once_it_is_known(monkeypatch: pytest.MonkeyPatch) -> None:
    told = _decided(monkeypatch, [*[True] * 8, *[False, False, True, False, False] * 20])
    assert told[7:] == [True] * 101
    told = _decided(monkeypatch, [*[False] * 30, *[True, False, True] * 20])
    assert told[29:] == [False] * 61


def test_pictures_that_say_nothing_are_no_looks(monkeypatch: pytest.MonkeyPatch) -> None:
    told = _decided(monkeypatch, [*[True] * 7, *[None] * 50, True])
    assert told == [*[None] * 57, True]


@settings(deadline=None)
@given(st.lists(st.sampled_from([True, False, None]), max_size=80))
def test_yes_and_no_are_said_only_when_enough_looks_agree(looks: list[bool | None]) -> None:
    with pytest.MonkeyPatch.context() as monkeypatch:
        told = _decided(monkeypatch, looks)
    before: bool | None = None
    for number, now in enumerate(told, 1):
        judged = [look for look in looks[:number] if look is not None]
        if now is not before:
            assert now is not None
            if now:
                assert sum(judged[-10:]) >= 8
            else:
                assert not any(judged[-30:])
                assert len(judged) >= 30
        before = now


def test_it_looks_twice_a_second_at_first_and_then_every_five_seconds(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    looked: list[float] = []

    def look(now: float) -> float:
        looked.append(now)
        return 0.0

    monkeypatch.setattr(rules, "magenta_share", look)
    detector = InfraredDetector()
    for tick in range(300):
        detector.check(0.1 * tick, 0.1 * tick)  # type: ignore[arg-type]
    assert looked[:10] == pytest.approx([0.5 * number for number in range(10)], abs=0.11)
    assert np.diff(looked[10:]) == pytest.approx(5.0, abs=0.11)
    assert len(looked) < 17


def _frames(folder: str) -> list[Image]:
    paths = sorted((_DATA / folder).rglob("*.jpg"))
    if not paths:
        pytest.skip("needs the real frames in ../shared/data")
    paths = paths[::8] if folder == "trail" else paths
    return [np.asarray(cv2.imread(str(path)), np.uint8)[..., ::-1] for path in paths]


@pytest.mark.slow
@pytest.mark.parametrize("folder", ["trail", "abroad", "frames", "sequence"])
def test_no_real_frame_is_taken_for_infrared(folder: str) -> None:
    for number, frame in enumerate(_frames(folder)):
        assert (magenta_share(frame) or 0.0) < SHARE
        assert (magenta_share(degraded(frame, "warm", number)) or 0.0) < SHARE


@pytest.mark.slow
@pytest.mark.parametrize("change", [lambda frame: infrared(frame, 1.0), lambda frame: magenta(frame, 0.75)])
def test_real_frames_with_infrared_are_recognised(change: Callable[[Image], Image]) -> None:
    found = [
        (magenta_share(change(np.ascontiguousarray(frame))) or 0.0) >= SHARE for frame in _frames("trail")
    ]
    assert np.mean(found) > 0.97
