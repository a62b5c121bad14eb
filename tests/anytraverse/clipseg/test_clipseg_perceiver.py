"""CLIPSeg as the eyes: maps, tapped things and scenes, and what they cost."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

from anytraverse.errors import ExampleError, PerceiverError
from anytraverse.perception import Example, Prompt
from anytraverse.perception.clipseg.perceiver import ClipSeg
from anytraverse.perception.runtime import Runtime
from anytraverse.regions import Box
from tests.anytraverse.clipseg.pictures import picture

TEXT = ["text-1", "text-2", "text-3"]
BOX = Box(0.3, 0.3, 0.7, 0.8)


def prompts(*words: str) -> list[Prompt]:
    return [Prompt(word) for word in words]


@pytest.mark.parametrize("size", [(64, 64), (640, 480), (48, 200), (5, 3), (1, 1)])
def test_maps_are_probabilities_at_the_models_size_whatever_the_frames(
    eyes: ClipSeg, size: tuple[int, int]
) -> None:
    maps = eyes.attend(eyes.encode(picture(*size, 1)), prompts("grass", "mud", "sky"))
    assert maps.shape == (3, 64, 64)
    assert maps.dtype == np.float32
    assert maps.min() >= 0
    assert maps.max() <= 1


def test_no_words_make_no_maps(eyes: ClipSeg, runs: list[str]) -> None:
    assert eyes.attend(eyes.encode(picture(64, 64, 1)), []).shape == (0, 64, 64)
    assert runs == ["image"]


def test_a_words_map_does_not_depend_on_what_else_is_asked(eyes: ClipSeg) -> None:
    frame = picture(64, 64, 2)
    words = [f"thing {number}" for number in range(16)]
    together = eyes.attend(eyes.encode(frame), prompts(*words))
    assert len({each.tobytes() for each in together}) == 16
    for index in (0, 7, 15):
        (alone,) = eyes.attend(eyes.encode(frame), prompts(words[index]))
        np.testing.assert_allclose(alone, together[index], rtol=0, atol=1e-6)
    backwards = eyes.attend(eyes.encode(frame), prompts(*reversed(words)))
    np.testing.assert_allclose(backwards[::-1], together, rtol=0, atol=1e-6)


def test_a_word_asked_twice_has_the_same_map_twice(eyes: ClipSeg) -> None:
    first, second = eyes.attend(eyes.encode(picture(64, 64, 3)), prompts("grass", "grass"))
    np.testing.assert_array_equal(first, second)


def test_what_was_asked_of_a_frame_is_not_computed_again(eyes: ClipSeg, runs: list[str]) -> None:
    features = eyes.encode(picture(64, 64, 3))
    first = eyes.attend(features, prompts("grass", "mud"))
    assert runs == ["image", *(part for part in TEXT for _ in range(2)), "decoder"]
    runs.clear()
    np.testing.assert_array_equal(eyes.attend(features, prompts("mud", "grass")), first[::-1])
    np.testing.assert_array_equal(eyes.embed(features), eyes.embed(features))
    assert runs == ["tail"]
    runs.clear()
    eyes.attend(features, prompts("grass", "mud", "sky"))
    assert runs == [*TEXT, "decoder"]


def test_maps_that_nobody_asks_for_any_more_are_not_kept(eyes: ClipSeg) -> None:
    features = eyes.encode(picture(64, 64, 3))
    for number in range(40):
        eyes.attend(features, prompts("grass", f"thing {number}"))
    assert list(features.maps) == ["grass", "thing 39"]


def test_maps_that_were_given_out_may_be_written_to(eyes: ClipSeg) -> None:
    features = eyes.encode(picture(64, 64, 3))
    first = eyes.attend(features, prompts("grass"))
    kept = first.copy()
    first[...] = 7
    np.testing.assert_array_equal(eyes.attend(features, prompts("grass")), kept)


def test_any_word_is_known_and_means_itself(eyes: ClipSeg) -> None:
    assert eyes.vocabulary is None
    assert eyes.meaning("  Dry   GRASS ") == "dry grass"


def test_the_scene_is_a_unit_vector_that_tells_pictures_apart(eyes: ClipSeg) -> None:
    first, again, other = (eyes.embed(eyes.encode(picture(64, 48, seed))) for seed in (1, 1, 2))
    assert first.dtype == np.float32
    assert first.shape == (24,)
    assert float(np.linalg.norm(first)) == pytest.approx(1.0, abs=1e-6)
    np.testing.assert_array_equal(first, again)
    assert float(first @ other) < 0.999


def test_an_encoder_of_its_own_makes_the_scene_and_the_tail_what_is_tapped(
    tiny_b32: Path, runs: list[str]
) -> None:
    eyes = ClipSeg(str(tiny_b32), Runtime(threads=1))
    features = eyes.encode(picture(64, 48, 1))
    scene = eyes.embed(features)
    assert runs == ["image", "scene"]
    assert scene.shape == (20,)
    assert float(np.linalg.norm(scene)) == pytest.approx(1.0, abs=1e-6)
    runs.clear()
    assert eyes.example(features, BOX).vector.shape == (24,)
    assert runs == ["image", "tail"]


def test_a_tail_that_is_lost_after_the_start_refuses_taps_and_nothing_else(
    tiny_b32: Path, tmp_path: Path
) -> None:
    folder = shutil.copytree(tiny_b32, tmp_path / "bundle")
    eyes = ClipSeg(str(folder), Runtime(threads=1))
    features = eyes.encode(picture(64, 48, 1))
    (folder / "tail.onnx").unlink()
    with pytest.raises(PerceiverError, match=r"cannot load tail\.onnx"):
        eyes.example(features, BOX)
    assert eyes.embed(features).shape == (20,)


def test_of_a_word_and_its_examples_the_larger_attention_counts(eyes: ClipSeg) -> None:
    features = eyes.encode(picture(64, 48, 1))
    tapped = eyes.example(features, BOX)
    (word,) = eyes.attend(features, prompts("gnome"))
    (both,) = eyes.attend(features, [Prompt("gnome", (tapped,))])
    assert (both >= word).all()
    assert (both > word).any()


def test_several_taps_count_as_their_mean(eyes: ClipSeg) -> None:
    features = eyes.encode(picture(64, 48, 1))
    taps = [eyes.example(features, box) for box in (BOX, Box(0.0, 0.0, 0.5, 0.5))]
    mean = Example(eyes.model_id, np.mean([tap.vector for tap in taps], axis=0))
    several = eyes.attend(features, [Prompt("gnome", tuple(taps))])
    np.testing.assert_allclose(several, eyes.attend(features, [Prompt("gnome", (mean,))]), rtol=0, atol=1e-5)


def test_sixteen_words_may_all_have_examples(eyes: ClipSeg) -> None:
    features = eyes.encode(picture(64, 48, 1))
    boxes = [Box(0.0, 0.0, 0.5 + 0.03 * number, 0.9) for number in range(16)]
    asked = [Prompt(f"thing {number}", (eyes.example(features, box),)) for number, box in enumerate(boxes)]
    maps = eyes.attend(features, asked)
    assert maps.shape == (16, 64, 64)
    (last,) = eyes.attend(eyes.encode(picture(64, 48, 1)), asked[-1:])
    np.testing.assert_allclose(last, maps[-1], rtol=0, atol=1e-6)


def test_a_box_is_looked_at_with_some_of_what_is_around_it(eyes: ClipSeg) -> None:
    frame = picture(200, 200, 1)
    near, far = frame.copy(), frame.copy()
    near[60:140, 58:60] ^= 255  # just outside the box, which begins at 60
    far[:, :40] ^= 255
    box = Box(0.3, 0.3, 0.7, 0.7)
    vectors = [eyes.example(eyes.encode(each), box).vector for each in (frame, near, far)]
    assert not np.array_equal(vectors[0], vectors[1])
    np.testing.assert_array_equal(vectors[0], vectors[2])


@pytest.mark.parametrize("box", [Box(0.5, 0.5, 0.55, 0.9), Box(0.1, 0.2, 0.9, 0.22)])
def test_a_box_that_shows_nothing_but_a_blur_is_refused(eyes: ClipSeg, box: Box) -> None:
    with pytest.raises(ExampleError, match="draw a larger one"):
        eyes.example(eyes.encode(picture(200, 200, 1)), box)


def test_examples_of_another_model_or_torn_ones_are_refused(eyes: ClipSeg) -> None:
    features = eyes.encode(picture(64, 48, 1))
    for example, reason in (
        (
            Example("tiny-96-shared-00000000", np.zeros(24, dtype=np.float32)),
            "tapped with tiny-96-shared-0000",
        ),
        (Example(eyes.model_id, np.zeros(23, dtype=np.float32)), "is not whole"),
    ):
        with pytest.raises(ExampleError, match=reason):
            eyes.attend(features, [Prompt("gnome", (example,))])


@pytest.mark.parametrize(
    "image",
    [
        np.zeros((48, 64), dtype=np.uint8),
        np.zeros((48, 64, 4), dtype=np.uint8),
        np.zeros((48, 64, 3), dtype=np.float32),
        np.zeros((0, 64, 3), dtype=np.uint8),
    ],
    ids=["grey", "with alpha", "floats", "empty"],
)
def test_what_is_no_picture_is_refused(eyes: ClipSeg, image: NDArray[np.uint8]) -> None:
    with pytest.raises(PerceiverError, match="a frame must be an RGB picture"):
        eyes.encode(image)
