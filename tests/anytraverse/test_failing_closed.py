"""Whatever is broken ends in a fault, never in OK."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
import pytest
from numpy.typing import NDArray

from anytraverse.assessment import Assessment, Reason
from anytraverse.errors import ExampleError, PerceiverError, PreferencesError, UnknownWordError
from anytraverse.frame import Frame, is_black, is_image
from anytraverse.judging import Settings, Thresholds
from anytraverse.memory import Memory
from anytraverse.perception import Example
from anytraverse.pooling import POOLINGS, UNCERTAINTIES
from anytraverse.preferences import Preferences
from anytraverse.regions import Box

if TYPE_CHECKING:
    from tests.anytraverse.conftest import Rover

Array = NDArray[Any]


def with_first(value: float) -> Callable[[Array], Array]:
    """One value of the array replaced: outside the ROI, where no figure would show it."""

    def spoil(array: Array) -> Array:
        spoilt = array.copy()
        spoilt[(0,) * array.ndim] = value
        return spoilt

    return spoil


@pytest.mark.parametrize(
    "spoil",
    [
        with_first(math.nan),
        with_first(math.inf),
        with_first(-math.inf),
        with_first(1.01),
        with_first(-0.01),
        lambda maps: maps[:1],
        lambda maps: maps[0],
        lambda maps: maps[:, :0],
        lambda maps: maps * math.nan,
    ],
)
def test_attention_that_is_not_what_was_promised_is_a_fault(
    rover: Rover, spoil: Callable[[Array], Array]
) -> None:
    rover.eyes.spoil_attention = spoil
    seen = rover.see()
    assert seen.reasons == {Reason.FAULT}
    assert not seen.ok
    assert seen.maps is None
    assert seen.similarity == pytest.approx(1)


@pytest.mark.parametrize(
    "spoil",
    [
        with_first(math.nan),
        with_first(math.inf),
        lambda vector: vector * 0,
        lambda vector: np.append(vector, 1),
        lambda vector: vector[np.newaxis],
        lambda vector: vector[:0],
    ],
)
def test_an_embedding_that_is_not_what_was_promised_is_a_fault(
    rover: Rover, spoil: Callable[[Array], Array]
) -> None:
    rover.eyes.spoil_embedding = spoil
    seen = rover.see()
    assert seen.reasons == {Reason.FAULT}
    assert seen.similarity is None
    assert rover.see(90).match is None


def test_attention_of_another_precision_is_judged_alike(rover: Rover) -> None:
    single = rover.see(thing="drum", sure=0.7)
    rover.eyes.spoil_attention = lambda maps: maps.astype(np.float64) + 1e-5
    double = rover.see(thing="drum", sure=0.7)
    assert double.maps is not None
    assert (
        double.maps.attention.dtype == double.maps.signed.dtype == double.maps.uncertainty.dtype == np.float32
    )
    assert single.roi is not None
    assert double.roi is not None
    assert double.roi.uncertainty == pytest.approx(single.roi.uncertainty, abs=1e-4)


@pytest.mark.parametrize(("factor", "shift"), [(1.0005, -0.0004), (1.0005, 0.0), (1.0, -0.0004)])
def test_attention_a_hair_outside_its_range_is_cut_to_it(rover: Rover, factor: float, shift: float) -> None:
    rover.eyes.spoil_attention = lambda maps: maps * np.float32(factor) + np.float32(shift)
    seen = rover.see()
    assert seen.ok
    assert seen.maps is not None
    assert seen.maps.uncertainty.min() >= 0
    assert seen.maps.uncertainty.max() <= 1
    assert seen.maps.attention.min() == 0
    assert seen.maps.attention.max() <= 1


def test_an_embedding_of_another_norm_is_compared_by_its_direction(rover: Rover) -> None:
    rover.eyes.spoil_embedding = lambda vector: vector * 40
    assert rover.see(60).similarity == pytest.approx(0.5)
    assert rover.see(60).reasons == {Reason.UNKNOWN_SCENE}


@pytest.mark.parametrize("captured_at", [-1e9, 1e9, math.nan, math.inf, -math.inf])
def test_a_frame_that_is_not_fresh_is_a_fault(rover: Rover, captured_at: float) -> None:
    assert rover.see(captured_at=captured_at).reasons == {Reason.FAULT}


@pytest.mark.parametrize(("captured", "says"), [(-2.0, "is 2.0 s old"), (0.5, "is 0.5 s ahead")])
def test_a_fault_of_age_says_how_old_the_frame_is(rover: Rover, captured: float, says: str) -> None:
    frame = rover.frame()
    finding = rover.engine.step(frame, frame.captured_at - captured).finding(Reason.FAULT)
    assert finding is not None
    assert says in finding.figure


@pytest.mark.parametrize(("age", "fresh"), [(0.0, True), (0.75, True), (0.8, False), (-0.01, False)])
def test_freshness_is_measured_from_the_capture(make_rover: type[Rover], age: float, fresh: bool) -> None:
    rover = make_rover("grass: 1", Settings(freshness=0.75))
    frame = rover.frame()
    seen = rover.engine.step(frame, frame.captured_at + age)
    assert seen.ok is fresh


@pytest.mark.parametrize(
    "image",
    [
        None,
        "picture.jpg",
        np.zeros((0, 10, 3), dtype=np.uint8),
        np.zeros((10, 10), dtype=np.uint8),
        np.zeros((10, 10, 4), dtype=np.uint8),
        np.zeros((10, 10, 3), dtype=np.float32),
    ],
)
def test_what_is_not_a_picture_is_a_fault_and_never_reaches_the_perceiver(rover: Rover, image: Any) -> None:
    assert not is_image(image)
    encoded = rover.eyes.encoded
    seen = rover.see(image=image)
    assert seen.reasons == {Reason.FAULT}
    assert seen.observation is None
    assert seen.age == pytest.approx(0.1)
    assert rover.eyes.encoded == encoded


def test_a_dark_picture_is_not_a_black_one() -> None:
    assert is_black(np.full((4, 4, 3), 3, dtype=np.uint8))
    assert not is_black(np.full((4, 4, 3), 4, dtype=np.uint8))


def test_an_uncertainty_that_is_not_finite_is_a_fault(
    make_rover: type[Rover], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(UNCERTAINTIES, "broken", lambda maps: maps[0] * np.float32(np.nan))
    rover = make_rover("grass: 1", Settings(uncertainty="broken"))
    assert rover.see().reasons == {Reason.FAULT}


def test_a_pooling_that_is_not_finite_is_a_fault(
    make_rover: type[Rover], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setitem(POOLINGS, "broken", lambda maps, _: maps[0] / np.float32(np.inf) * np.inf)
    rover = make_rover("grass: 1", Settings(pooling="broken"))
    with np.errstate(invalid="ignore"):
        assert rover.see().reasons == {Reason.FAULT}


def test_a_roi_without_a_pixel_is_a_fault(make_rover: type[Rover]) -> None:
    rover = make_rover("grass: 1", Settings(region=Box(0.501, 0.501, 0.502, 0.502), misfit_allowed=True))
    seen = rover.see()
    assert seen.reasons == {Reason.FAULT}
    assert seen.roi is None
    assert seen.maps is not None


def test_a_perceiver_that_says_it_failed_is_a_fault_in_its_words(rover: Rover) -> None:
    def fail(_: object) -> Array:
        raise PerceiverError("the model has\nrun out of\x1bmemory")

    rover.eyes.spoil_embedding = fail
    in_encoding = rover.see()
    rover.eyes.spoil_embedding = lambda vector: vector
    rover.eyes.spoil_attention = fail
    for seen in (in_encoding, rover.see()):
        finding = seen.finding(Reason.FAULT)
        assert finding is not None
        assert finding.figure == "the model has run out of memory"
        assert not seen.ok


@pytest.mark.parametrize("thresholds", [Thresholds(), Thresholds(roi=1, tile=1, trav=0)])
def test_without_words_all_is_uncertain_and_nothing_is_ok(
    make_rover: type[Rover], thresholds: Thresholds
) -> None:
    rover = make_rover("", Settings(thresholds=thresholds))
    seen = rover.see()
    assert seen.reasons == {Reason.UNKNOWN_OBJECT}
    assert seen.roi is not None
    assert seen.roi.uncertainty == seen.roi.worst_tile.uncertainty == 1
    assert not seen.is_clear(Reason.UNKNOWN_OBJECT)


def test_an_assessment_without_findings_is_neither_ok_nor_clear() -> None:
    frame = Frame(1, 0.0, np.ones((2, 2, 3), dtype=np.uint8))
    empty = Assessment(frame, Preferences(), (), 0.0)
    assert not empty.ok
    assert not any(empty.is_clear(reason) for reason in Reason)


def test_nothing_is_clear_in_a_frame_with_a_fault(rover: Rover) -> None:
    seen = rover.see(captured_at=0.0)
    assert not any(seen.is_clear(reason) for reason in Reason)
    assert all(rover.see().is_clear(reason) for reason in Reason)


def test_a_reference_of_another_length_is_a_fault_until_a_new_episode(
    rover: Rover, make_rover: type[Rover]
) -> None:
    words = Preferences.parse("grass: 1")
    broken = Memory(
        "painted-1", words, words, reference=np.ones(5, dtype=np.float32), history=rover.memory.history
    )
    again = make_rover("", memory=broken)
    assert again.see().reasons == {Reason.FAULT}
    finding = again.see().finding(Reason.FAULT)
    assert finding is not None
    assert "new episode" in finding.figure
    again.answer(new_episode=True)
    assert again.see().ok


def test_nothing_that_comes_in_is_changed(rover: Rover) -> None:
    def locked(array: Array) -> Array:
        array.flags.writeable = False
        return array

    rover.eyes.spoil_attention = rover.eyes.spoil_embedding = locked
    for array in (rover.memory.reference, *(entry.embedding for entry in rover.memory.history)):
        assert array is not None
        array.flags.writeable = False
    call = rover.call(90, thing="drum")
    rover.answer({"drum": -1}, call, 7)
    rover.see(0)
    rover.see(0)
    assert rover.see(thing="drum").reasons == {Reason.BLOCKED}


def test_a_memory_that_the_perceiver_cannot_use_is_refused_at_the_start(make_rover: type[Rover]) -> None:
    foreign = {"grass": (Example("other-2", np.zeros(1, dtype=np.float32)),)}
    refused: list[tuple[Memory, type[Exception], str]] = [
        (Memory("other-2"), PerceiverError, "resume it"),
        (Memory("painted-1", Preferences.parse("gnome: 1")), UnknownWordError, "gnome"),
        (Memory("painted-1", Preferences.parse("path: 1; trail: -1")), PreferencesError, "contradicts"),
        (Memory("painted-1", Preferences.parse("grass: 1"), examples=foreign), ExampleError, "grass"),
    ]
    for memory, error, reason in refused:
        with pytest.raises(error, match=reason):
            make_rover("", memory=memory)
