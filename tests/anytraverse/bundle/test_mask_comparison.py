"""When int8's masks are as good as fp32's."""

from __future__ import annotations

import numpy as np
import pytest

from anytraverse.bundle.comparing import FEWEST_MASKS, Array, BundleComparison, TimedOutputs

SIDE = 100
SCENE = np.array([1.0, 0.0], dtype=np.float32)


def block(width: int, height: int = SIDE, left: int = 0) -> Array:
    """A map, sure in a block of pixels and nowhere else."""
    grid = np.zeros((SIDE, SIDE), dtype=np.float32)
    grid[:height, left : left + width] = 0.9
    return grid


def seen(*maps: Array, embedding: Array = SCENE) -> TimedOutputs:
    """What a perceiver sees in a frame."""
    return TimedOutputs(np.stack(maps), embedding, 1.0)


def compared(fp32: TimedOutputs, int8: TimedOutputs, *, frames: int = FEWEST_MASKS) -> BundleComparison:
    """Both saw the same in every frame."""
    comparison = BundleComparison(["grass", "rock"][: len(fp32.maps)])
    for _ in range(frames):
        comparison.add(fp32, int8)
    return comparison


def test_equal_masks_pass_and_the_reason_has_the_figures() -> None:
    passed, why = compared(seen(block(50), block(30)), seen(block(50), block(30))).verdict(2.84)
    assert passed
    assert why == 'worst IoU 1.000 ("grass"), 2.8 times as fast as fp32'


@pytest.mark.parametrize(("height", "passed"), [(96, False), (97, True), (99, True)])
def test_the_masks_of_a_word_must_overlap(height: int, passed: bool) -> None:
    assert compared(seen(block(50)), seen(block(50, height))).verdict(2.0)[0] is passed


def test_a_large_word_does_not_hide_a_small_one() -> None:
    passed, why = compared(seen(block(90), block(20, 20)), seen(block(90), block(21, 20))).verdict(2.0)
    assert not passed
    assert 'IoU of "rock" with fp32 is 0.952' in why


def test_many_good_frames_do_not_hide_one_that_broke() -> None:
    comparison = compared(seen(block(50)), seen(block(50)), frames=60)
    comparison.add(seen(block(50)), seen(block(40)))
    assert comparison.worst_word is not None
    assert comparison.worst_word[1] > 0.99
    passed, why = comparison.verdict(2.0)
    assert not passed
    assert "one mask is 0.800" in why


def test_specks_are_not_held_to_the_floor_of_single_masks() -> None:
    comparison = compared(seen(block(50)), seen(block(50)), frames=60)
    comparison.add(seen(block(10, 5)), seen(block(8, 5)))
    assert comparison.iou_worst == pytest.approx(0.8)
    assert comparison.verdict(2.0)[0]


@pytest.mark.parametrize("fp32", [0.1, 0.9])
def test_masks_that_are_empty_or_full_are_not_compared(fp32: float) -> None:
    flat = np.full((SIDE, SIDE), fp32, dtype=np.float32)
    comparison = compared(seen(flat), seen(flat), frames=50)
    assert comparison.masks == 0
    assert comparison.iou_mean is None
    passed, why = comparison.verdict(2.0)
    assert not passed
    assert "only 0 masks" in why


def test_int8_must_not_see_what_fp32_does_not_see_at_all() -> None:
    comparison = compared(seen(block(50)), seen(block(50)))
    comparison.add(seen(block(0)), seen(block(1)))
    assert comparison.verdict(2.0)[0]
    comparison.add(seen(block(0)), seen(block(2)))
    passed, why = comparison.verdict(2.0)
    assert not passed
    assert "2.0% of a picture" in why


def test_few_masks_prove_nothing() -> None:
    passed, why = compared(seen(block(50)), seen(block(50)), frames=FEWEST_MASKS - 1).verdict(2.0)
    assert not passed
    assert "give more frames" in why


@pytest.mark.parametrize(("cosine", "passed"), [(0.991, True), (0.989, False)])
def test_embeddings_must_agree(cosine: float, passed: bool) -> None:
    turned = np.array([cosine, np.sqrt(1 - cosine**2)], dtype=np.float32)
    assert compared(seen(block(50)), seen(block(50), embedding=turned)).verdict(2.0)[0] is passed


@pytest.mark.parametrize(("gain", "passed"), [(0.76, False), (1.09, False), (1.11, True)])
def test_int8_must_pay(gain: float, passed: bool) -> None:
    assert compared(seen(block(50)), seen(block(50))).verdict(gain)[0] is passed


@pytest.mark.parametrize("value", [np.nan, np.inf])
def test_numbers_that_are_not_finite_fail(value: float) -> None:
    broken = block(50)
    broken[0, 0] = value
    scene = np.array([value, 0.0], dtype=np.float32)
    for int8 in (seen(broken), seen(block(50), embedding=scene)):
        passed, why = compared(seen(block(50)), int8).verdict(2.0)
        assert not passed
        assert "not finite" in why


def test_outputs_of_another_size_fail() -> None:
    small = TimedOutputs(np.zeros((1, 8, 8), dtype=np.float32), SCENE, 1.0)
    assert compared(seen(block(50)), small).verdict(2.0) == (False, "its outputs are of another size")
