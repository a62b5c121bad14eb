"""What the built-in network promises as a perceiver, on drawn pictures, and which files it refuses."""

from __future__ import annotations

import math
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from anytraverse.errors import ExampleError, PerceiverError, UnknownWordError
from anytraverse.frame import Image
from anytraverse.perception import Example, Prompt, make_perceiver
from anytraverse.perception.builtin.calibration import Calibration
from anytraverse.perception.builtin.network import Outputs
from anytraverse.perception.builtin.perceiver import SHIPPED, GroundNetwork
from anytraverse.perception.builtin.words import GROUND_WORDS
from anytraverse.perception.runtime import Runtime
from companion.sim.field.render import PinholeCamera
from companion.sim.field.things import World

KNOWN = sorted(GROUND_WORDS)
FRAMES = Path(__file__).parents[3] / "shared" / "data" / "trail"


@pytest.fixture(scope="module")
def eyes() -> GroundNetwork:
    """The network that ships."""
    return GroundNetwork(SHIPPED, Runtime(threads=1))


@pytest.fixture(scope="module")
def drawn() -> Image:
    """Sky, grass, a dirt path up the middle."""
    rng = np.random.default_rng(1)
    picture = np.empty((240, 320, 3))
    picture[:90] = (150, 185, 235)
    mottle = 1 + 0.13 * rng.standard_normal((150, 320, 1))
    picture[90:] = np.asarray((84, 116, 48)) * mottle
    picture[90:, 100:220] = (np.asarray((148, 118, 84)) * mottle)[:, 100:220]
    return picture.clip(0, 255).astype(np.uint8)


def attend(eyes: GroundNetwork, image: Image, *words: str) -> NDArray[np.float32]:
    return eyes.attend(eyes.encode(image), [Prompt(word) for word in words])


def test_maps_are_float32_in_0_to_1_in_the_order_of_the_prompts(eyes: GroundNetwork, drawn: Image) -> None:
    maps = attend(eyes, drawn, "grass", "dirt path", "sky", "tree")
    assert maps.dtype == np.float32
    assert maps.shape == (4, 48, 64)
    assert maps.min() >= 0.0
    assert maps.max() <= 1.0
    np.testing.assert_allclose(
        attend(eyes, drawn, "tree", "sky", "dirt path", "grass")[::-1], maps, atol=1e-6
    )


def test_no_prompts_give_no_maps(eyes: GroundNetwork, drawn: Image) -> None:
    assert attend(eyes, drawn).shape == (0, 48, 64)


@pytest.mark.skipif(
    not FRAMES.is_dir(), reason="needs the labelled frames beside the checkout: ../shared/data"
)
def test_words_find_filmed_ground_and_sky(eyes: GroundNetwork) -> None:
    from anytraverse.training.folders import read_folder

    found: list[tuple[float, float]] = []
    skies: list[float] = []
    for frame in read_folder(FRAMES).of([2]).frames[::12]:
        prompts = [Prompt(word, drivable=True) for word in ("trail", "grass")]
        ground = eyes.attend(eyes.encode(frame.image), prompts).max(axis=0)
        true = cv2.resize(frame.labels, ground.shape[::-1], interpolation=cv2.INTER_NEAREST_EXACT)
        drivable, sky = np.isin(true, (0, 1, 2)), true == 5
        found.append((float(ground[drivable].mean()), float(ground[sky].mean()) if sky.any() else 0.0))
        if sky.any():
            skies.append(float(eyes.attend(eyes.encode(frame.image), [Prompt("sky")])[0][sky].mean()))
    assert np.mean(found, axis=0)[0] > 0.75
    assert np.mean(found, axis=0)[1] < 0.05
    assert np.mean(skies) > 0.7


@settings(max_examples=25)
@given(asked=st.lists(st.sampled_from(KNOWN), min_size=1, max_size=8), more=st.sampled_from(KNOWN))
def test_another_word_of_the_same_side_makes_nothing_more_uncertain(
    eyes: GroundNetwork, drawn: Image, asked: list[str], more: str
) -> None:
    before = 1 - attend(eyes, drawn, *asked).max(axis=0)
    after = 1 - attend(eyes, drawn, *asked, more).max(axis=0)
    assert (after <= before + 1e-4).all()


@settings(max_examples=25)
@given(
    asked=st.lists(st.sampled_from(KNOWN), min_size=1, max_size=6),
    against=st.lists(st.sampled_from(KNOWN), min_size=1, max_size=4),
)
def test_a_word_of_the_other_side_makes_no_ground_more_drivable(
    eyes: GroundNetwork, drawn: Image, asked: list[str], against: list[str]
) -> None:
    seen = eyes.encode(drawn)
    drivable = [Prompt(word, drivable=True) for word in asked]
    alone = eyes.attend(seen, drivable).max(axis=0)
    both = eyes.attend(seen, [*drivable, *(Prompt(word, drivable=False) for word in against)])
    assert both.min() >= 0
    assert both.max() <= 1
    assert (both[: len(asked)].max(axis=0) <= alone + 1e-4).all()


def test_words_of_one_side_share_what_they_explain(eyes: GroundNetwork, drawn: Image) -> None:
    seen = eyes.encode(drawn)
    trail, grass = eyes.attend(seen, [Prompt("trail")])[0], eyes.attend(seen, [Prompt("grass")])[0]
    both = eyes.attend(seen, [Prompt("trail", drivable=True), Prompt("grass", drivable=True)])
    np.testing.assert_allclose(both.max(axis=0), trail + grass, atol=1e-5)
    apart = eyes.attend(seen, [Prompt("trail", drivable=True), Prompt("grass", drivable=False)])
    np.testing.assert_allclose(apart, np.stack([trail, grass]), atol=1e-5)


@settings(max_examples=15)
@given(word=st.sampled_from(KNOWN), copies=st.integers(2, 4))
def test_a_word_asked_several_times_explains_no_more_than_once(
    eyes: GroundNetwork, drawn: Image, word: str, copies: int
) -> None:
    once, often = attend(eyes, drawn, word), attend(eyes, drawn, *[word] * copies)
    np.testing.assert_allclose(often.max(axis=0), once[0], atol=1e-5)


def test_ground_that_nobody_asked_about_is_uncertain(eyes: GroundNetwork, drawn: Image) -> None:
    assert attend(eyes, drawn, "sky", "water").max(axis=0)[30:].mean() < 0.2


def test_synonyms_mean_the_same_and_every_word_can_be_grounded(eyes: GroundNetwork, drawn: Image) -> None:
    assert eyes.meaning("Path") == "trail"
    assert eyes.meaning("puddle") == "water"
    np.testing.assert_array_equal(attend(eyes, drawn, "dirt path"), attend(eyes, drawn, "soil"))
    assert {eyes.meaning(word) for word in eyes.vocabulary} == set(GROUND_WORDS)
    assert np.isfinite(attend(eyes, drawn, *eyes.vocabulary)).all()


def test_weak_words_say_that_they_are(eyes: GroundNetwork) -> None:
    assert eyes.trust("puddle") == eyes.trust("rock") == "weak"
    assert eyes.trust("grass") == "good"
    with pytest.raises(UnknownWordError):
        eyes.trust("gnome")


@pytest.mark.parametrize(("word", "near"), [("graas", "grass"), ("gravvel", "gravel"), ("bolder", "rock")])
def test_a_word_that_is_not_known_is_refused_with_the_nearest_first(
    eyes: GroundNetwork, drawn: Image, word: str, near: str
) -> None:
    with pytest.raises(UnknownWordError, match=rf'"{word}".*knows: {near}, .*tap'):
        eyes.meaning(word)
    with pytest.raises(UnknownWordError, match=word):
        attend(eyes, drawn, "grass", word)


def test_the_scene_is_a_unit_vector_that_light_hardly_turns(eyes: GroundNetwork) -> None:
    world = World(31, ())
    trail, camera = world.trail, PinholeCamera(world, 320, 240)
    places = {trail.zone(trail.start + s): trail.start + s for s in (5.0, 50.0, 100.0)}
    meadow, *others = (camera.render(trail.pose(s), 0.0)[0] for s in places.values())
    here = eyes.embed(eyes.encode(meadow))
    assert here.dtype == np.float32
    assert float(here @ here) == pytest.approx(1.0, abs=1e-5)
    darker = eyes.embed(eyes.encode((meadow * 0.6).astype(np.uint8)))
    assert float(here @ darker) > eyes.defaults.scene
    assert others
    assert all(float(here @ eyes.embed(eyes.encode(other))) < eyes.defaults.scene for other in others)


@pytest.mark.parametrize("shape", [(1, 1), (2, 3), (3, 900), (900, 3), (17, 31), (480, 640), (360, 640)])
def test_pictures_of_any_size_are_judged(eyes: GroundNetwork, shape: tuple[int, int]) -> None:
    seen = eyes.encode(np.full((*shape, 3), 90, dtype=np.uint8))
    assert np.isfinite(eyes.attend(seen, [Prompt("grass"), Prompt("gravel"), Prompt("dirt")])).all()
    assert np.linalg.norm(eyes.embed(seen)) == pytest.approx(1.0, abs=1e-5)


@pytest.mark.parametrize("level", [0, 255])
def test_black_and_white_pictures_stay_finite(eyes: GroundNetwork, level: int) -> None:
    seen = eyes.encode(np.full((240, 320, 3), level, dtype=np.uint8))
    assert np.isfinite(eyes.attend(seen, [Prompt("grass"), Prompt("mud"), Prompt("sand")])).all()
    assert np.isfinite(eyes.embed(seen)).all()


def test_what_is_no_picture_is_refused(eyes: GroundNetwork) -> None:
    pictures: list[Any] = [np.zeros((4, 4), np.uint8), np.zeros((4, 4, 3)), np.zeros((0, 4, 3), np.uint8)]
    for wrong in pictures:
        with pytest.raises(PerceiverError, match="RGB"):
            eyes.encode(wrong)


def test_output_that_is_not_finite_is_an_error(
    eyes: GroundNetwork, drawn: Image, monkeypatch: pytest.MonkeyPatch
) -> None:
    broken = GroundNetwork(SHIPPED, Runtime(threads=1))
    seen = Outputs(*(np.zeros_like(each) for each in eyes.encode(drawn).outputs))
    monkeypatch.setattr(broken, "_run", lambda _: seen)
    for worthless in seen:
        worthless[0, 0, 0] = math.nan
        with pytest.raises(PerceiverError, match="not finite"):
            broken.encode(drawn)
        worthless[0, 0, 0] = 0


def test_it_is_made_by_name_and_by_file(tmp_path: Path, eyes: GroundNetwork) -> None:
    own = copied(tmp_path)
    assert make_perceiver("builtin", Runtime(threads=1)).model_id == eyes.model_id
    assert make_perceiver(f"builtin:{own}", Runtime(threads=1)).model_id == eyes.model_id


def test_another_calibration_is_another_model(tmp_path: Path, eyes: GroundNetwork) -> None:
    own = copied(tmp_path)
    numbers = Calibration.load(own.with_suffix(".npz"))
    replace(numbers, slope=numbers.slope + 1).save(own.with_suffix(".npz"))
    other = GroundNetwork(own, Runtime(threads=1))
    assert other.model_id != eyes.model_id
    stranger = Example(eyes.model_id, np.zeros(80, dtype=np.float32))
    with pytest.raises(ExampleError, match="tap the thing again"):
        other.attend(other.encode(np.zeros((24, 32, 3), np.uint8)), [Prompt("drum", (stranger,))])


@pytest.mark.parametrize("lost", [".onnx", ".npz"])
def test_a_file_that_is_missing_is_named_with_what_to_give(tmp_path: Path, lost: str) -> None:
    own = copied(tmp_path)
    own.with_suffix(lost).unlink()
    with pytest.raises(PerceiverError, match=rf"own\{lost}.*no such file.*FILE\.npz beside it"):
        make_perceiver(f"builtin:{own}", Runtime(threads=1))


@pytest.mark.parametrize("torn", [".onnx", ".npz"])
def test_a_torn_file_is_refused(tmp_path: Path, torn: str) -> None:
    own = copied(tmp_path)
    whole = own.with_suffix(torn).read_bytes()
    own.with_suffix(torn).write_bytes(whole[: len(whole) // 2])
    with pytest.raises(PerceiverError, match=rf"own\{torn}"):
        make_perceiver(f"builtin:{own}", Runtime(threads=1))


@pytest.mark.parametrize(
    "wrong",
    [
        {"bias": np.zeros(7, np.float32)},
        {"tap_mean": np.zeros(36, np.float32)},
        {"scene_projection": np.zeros((32, 64), np.float32)},
        {"classes": tuple("abcdefgh")},
        {"slope": -1.0},
        {"limits": np.zeros(2, np.float32)},
        {"limits": np.ones(3, np.float32)},
        {"distance_mean": np.zeros(3, np.float32)},
        {"distance_whitening": np.eye(3, dtype=np.float32)},
        {"distance_centres": np.zeros((2, 3), np.float32)},
        {"scene_match": np.zeros((2, 3), np.float32)},
        {"scene_threshold": 1.0},
        {"surroundings_mean": np.zeros(3, np.float32)},
        {"surroundings_whitening": np.eye(3, dtype=np.float32)},
    ],
    ids=lambda wrong: next(iter(wrong)),
)
def test_a_calibration_of_another_network_is_refused(tmp_path: Path, wrong: dict[str, Any]) -> None:
    own = copied(tmp_path)
    replace(Calibration.load(own.with_suffix(".npz")), **wrong).save(own.with_suffix(".npz"))
    with pytest.raises(PerceiverError, match=r"no pair of one training.*fit it again"):
        make_perceiver(f"builtin:{own}", Runtime(threads=1))


def test_files_of_an_older_version_are_refused_with_what_to_do(tmp_path: Path) -> None:
    own = copied(tmp_path)
    with np.load(own.with_suffix(".npz")) as stored:
        kept = {name: stored[name] for name in stored.files if name != "limits"}
    np.savez(own.with_suffix(".npz"), gamma=9.8, **kept)
    with pytest.raises(PerceiverError, match=r"own\.npz has no 'limits.*older version.*fit it again"):
        make_perceiver(f"builtin:{own}", Runtime(threads=1))


def copied(folder: Path) -> Path:
    """The network that ships as a user's own file."""
    for suffix in (".onnx", ".npz"):
        shutil.copy(SHIPPED.with_suffix(suffix), folder / f"own{suffix}")
    return folder / "own.onnx"
