"""The perceiver of kind "dense", with tiny random weights."""

from __future__ import annotations

import hashlib
import io
import json
import sys
from pathlib import Path

import numpy as np
import pytest

from anytraverse.engine import AnyTraverse
from anytraverse.errors import BundleError, ExampleError, PerceiverError
from anytraverse.frame import Frame
from anytraverse.judging import Settings
from anytraverse.memory import first_memory
from anytraverse.perception import Example, Prompt, make_perceiver
from anytraverse.perception.dense.details import ScoreCalibration
from anytraverse.perception.dense.perceiver import Dense, Patches
from anytraverse.perception.runtime import Runtime
from anytraverse.perception.text_tower import TextTower
from anytraverse.preferences import Preferences
from anytraverse.regions import Box
from tests.anytraverse.clipseg.pictures import picture
from tests.anytraverse.dense.conftest import CHECKING, ONE

pytest.importorskip("onnx", reason="exports need onnx")


def test_a_word_of_the_bundle_has_the_embedding_that_the_text_tower_would_give(
    eyes: Dense, runs: list[str]
) -> None:
    seen = eyes.encode(picture(96, 72, 1))
    known = eyes.scores(seen, ["grass", "dirt path"])
    assert not [name for name in runs if name.startswith("text-")]
    eyes._words._known.clear()
    np.testing.assert_allclose(eyes.scores(seen, ["grass", "dirt path"]), known, rtol=0, atol=1e-6)
    assert "text-1" in runs


def test_a_frame_is_one_run_and_a_word_heard_before_is_none(eyes: Dense, runs: list[str]) -> None:
    eyes.attend(eyes.encode(picture(96, 72, 1)), [Prompt("grass"), Prompt("a stile")])
    assert "text-1" in runs
    runs.clear()
    seen = eyes.encode(picture(96, 72, 2))
    eyes.attend(seen, [Prompt("a stile"), Prompt("grass")])
    eyes.embed(seen)
    eyes.example(seen, Box(0.1, 0.5, 0.9, 1.0))
    assert runs == ["image", "scores"]


def test_attention_is_one_half_at_the_threshold_and_rises_with_the_score(eyes: Dense) -> None:
    eyes.calibration = ScoreCalibration(0.1, 0.02, 20, 0.05)
    seen = eyes.encode(picture(96, 72, 1))
    scores = eyes.scores(seen, ["grass"])
    (attention,) = eyes.attend(seen, [Prompt("grass")])
    np.testing.assert_allclose(attention, 1 / (1 + np.exp(-(scores[0] - 0.1) / 0.02)), rtol=1e-4, atol=1e-6)
    eyes.calibration = ScoreCalibration(float(scores[0, 2, 3]), 1e-6, 20, 0.05)
    attention = eyes.attend(seen, [Prompt("grass")])[0]
    assert attention[2, 3] == pytest.approx(0.5, abs=0.01)
    assert np.isfinite(attention).all()  # also at a temperature that would overflow an exponential
    assert attention.min() >= 0.0
    assert attention.max() <= 1.0


def test_a_words_map_does_not_depend_on_other_words(eyes: Dense) -> None:
    seen = eyes.encode(picture(96, 72, 3))
    words = [Prompt("grass"), Prompt("mud"), Prompt("a thing {of} braces")]
    together = eyes.attend(seen, words)
    for each, word in zip(together, words, strict=True):
        np.testing.assert_allclose(each, eyes.attend(seen, [word])[0], atol=1e-6)
    assert eyes.attend(seen, []).shape == (0, 8, 8)
    assert eyes.vocabulary is None
    assert eyes.meaning(" Fallen  TREE ") == "fallen tree"


def test_a_tapped_thing_is_found_where_it_was_tapped(eyes: Dense) -> None:
    rows = np.zeros((32, 8, 8), dtype=np.float32)
    rows[0], rows[1, 5:, 2:6] = 1.0, 3.0  # a thing below, of another direction than the rest
    seen = Patches(rows / np.linalg.norm(rows, axis=0), np.ones(32, dtype=np.float32))
    tapped = eyes.example(seen, Box(0.25, 0.625, 0.75, 1.0))
    (attention,) = eyes.attend(seen, [Prompt("drum", (tapped,))])
    assert (attention[5:, 2:6] > 0.99).all()
    eyes.calibration = ScoreCalibration(1.9, 0.01, 20, 0.05)  # no word reaches this
    (attention,) = eyes.attend(seen, [Prompt("drum", (tapped,))])
    assert attention[:5].max() < 0.01
    with pytest.raises(ExampleError, match="too small"):
        eyes.example(seen, Box(0.5, 0.5, 0.55, 0.55))
    with pytest.raises(ExampleError, match="tap the thing again"):
        eyes.attend(seen, [Prompt("drum", (Example("another", tapped.vector),))])


def test_the_scene_is_the_models_own_embedding(eyes: Dense) -> None:
    first, again, other = (eyes.embed(eyes.encode(picture(96, 72, seed))) for seed in (1, 1, 2))
    assert np.linalg.norm(first) == pytest.approx(1.0)
    assert float(first @ again) == pytest.approx(1.0)
    assert float(first @ other) < 0.9999


def test_it_serves_the_engine(calibrated: Path) -> None:
    eyes = make_perceiver(f"dense:{calibrated}", ONE)
    memory = first_memory(eyes.model_id, Preferences.of({"grass": 1.0, "rock": -1.0}))
    engine = AnyTraverse(eyes, Settings(), memory)
    seen = engine.observe(Frame(0, 0.0, picture(96, 72, 1)))
    assessment = engine.judge(seen, 0.0)
    attention = eyes.attend(eyes.encode(picture(96, 72, 1)), [Prompt("grass"), Prompt("rock")])
    assert assessment.maps is not None
    np.testing.assert_allclose(assessment.maps.uncertainty, 1.0 - attention.max(axis=0), atol=1e-5)


def test_a_bundle_that_is_not_calibrated_is_refused_with_the_command_that_does_it(bundle: Path) -> None:
    with pytest.raises(BundleError, match=r"not calibrated.*bundle check .*--frames FOLDER"):
        make_perceiver(f"dense:{bundle}", ONE)
    Dense(str(bundle), CHECKING)  # a check must be able to load it
    with pytest.raises(PerceiverError, match='write "dense:FOLDER"'):
        make_perceiver("dense", ONE)


@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"grid": 9}, "does not fit its manifest"),
        ({"width": 16}, "embeddings of 16 values"),
        ({"absent": ["piano"] * 16}, "each of them once"),
        ({"words": ["grass"]}, "holds no 1 embeddings"),
        ({"words": ["grass"] * 2}, "each of them once"),
        ({"templates": ["a photo"]}, "must hold {} once"),
        ({"family": "clip"}, "one of siglip, tipsv2"),
        ({"more": 1}, "only family"),
        ({"calibration": {"threshold": 0.1}}, "temperature is missing"),
    ],
)
def test_details_that_do_not_fit_are_refused(bundle: Path, changes: dict[str, object], reason: str) -> None:
    path = bundle / "manifest.json"
    manifest = json.loads(path.read_text())
    manifest["details"] |= changes
    path.write_text(json.dumps(manifest))
    with pytest.raises(BundleError, match=reason):
        Dense(str(bundle), CHECKING).encode(picture(96, 72, 1))


def test_output_that_is_not_finite_is_a_fault(eyes: Dense, monkeypatch: pytest.MonkeyPatch) -> None:
    def broken(*_: object) -> list[np.ndarray]:
        return [np.full((64, 32), np.nan, dtype=np.float32), np.ones(32, dtype=np.float32)]

    monkeypatch.setattr("anytraverse.perception.dense.perceiver.run_session", broken)
    with pytest.raises(PerceiverError, match="not finite"):
        eyes.encode(picture(96, 72, 1))


@pytest.mark.parametrize("name", ["image.onnx", "tokens.npy", "absent.npy", "words.npy", "tokenizer.json"])
def test_a_torn_file_is_refused(bundle: Path, name: str) -> None:
    path = bundle / name
    content = bytearray(path.read_bytes())
    content[len(content) // 2] ^= 1
    path.write_bytes(content)
    with pytest.raises(BundleError, match="is torn"):
        Dense(str(bundle), CHECKING)


def replaced(bundle: Path, name: str, content: bytes) -> None:
    """Replace a file of the bundle, and state its new size and hash."""
    (bundle / name).write_bytes(content)
    path = bundle / "manifest.json"
    manifest = json.loads(path.read_text())
    manifest["files"][name] = {"size": len(content), "sha256": hashlib.sha256(content).hexdigest()}
    path.write_text(json.dumps(manifest))


def test_a_tokenizer_that_cannot_be_used_is_refused_at_the_start_and_not_at_a_new_word(
    bundle: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with monkeypatch.context() as lacking:
        lacking.setitem(sys.modules, "tokenizers", None)
        with pytest.raises(PerceiverError, match=r"pip install .*\[words\]"):
            Dense(str(bundle), CHECKING)
    replaced(bundle, "tokenizer.json", b'{"format":1,"rules":{},"vocabulary":[],"merges":[]}')
    with pytest.raises(PerceiverError, match=r"an earlier version wrote it.*`anytraverse export`"):
        Dense(str(bundle), CHECKING)


def npy(header: str) -> bytes:
    """A .npy file of this header and 64 bytes."""
    line = header.encode() + b"\n"
    return b"\x93NUMPY\x01\x00" + len(line).to_bytes(2, "little") + line + bytes(64)


@pytest.mark.parametrize("name", ["words.npy", "absent.npy", "tokens.npy"])
@pytest.mark.parametrize(
    "header",
    [
        "{'descr': '<f4', 'fortran_order': False, 'shape': (1000000000000, 32)}",
        "{'descr': '<f4', 'fortran_order': False, 'shape': (-1, 32)}",
        "{'descr': '|O', 'fortran_order': False, 'shape': (2, 4)}",
        "{'descr': '<f4', 'fortran_order': False, 'shape': (2, 4",
        "{",
        "",
    ],
)
def test_a_table_whose_header_is_wrong_is_refused(bundle: Path, name: str, header: str) -> None:
    replaced(bundle, name, npy(header))
    with pytest.raises(BundleError, match=rf"{name} cannot be read .* copy the bundle again"):
        Dense(str(bundle), CHECKING)


@pytest.mark.parametrize("name", ["words.npy", "absent.npy"])
def test_a_zip_in_place_of_embeddings_is_refused(bundle: Path, name: str) -> None:
    packed = io.BytesIO()
    np.savez(packed, np.ones((8, 32), dtype=np.float32))
    replaced(bundle, name, packed.getvalue())
    with pytest.raises(BundleError, match="cannot be read"):
        Dense(str(bundle), CHECKING)


@pytest.mark.parametrize("name", ["words.npy", "absent.npy"])
@pytest.mark.parametrize("factor", [0.0, 100.0, float("nan")])
def test_embeddings_that_are_not_of_length_1_are_refused(bundle: Path, name: str, factor: float) -> None:
    changed = io.BytesIO()
    np.save(changed, np.load(bundle / name) * np.float32(factor))
    replaced(bundle, name, changed.getvalue())
    with pytest.raises(BundleError, match="not of length 1: export it again"):
        Dense(str(bundle), CHECKING)


def test_a_bundle_without_text_networks_is_refused_at_a_new_word(bundle: Path) -> None:
    path = bundle / "manifest.json"
    manifest = json.loads(path.read_text())
    parts = manifest["variants"]["fp32"]
    manifest["variants"]["fp32"] = {part: file for part, file in parts.items() if part[:5] != "text-"}
    path.write_text(json.dumps(manifest))  # a text is then the rows of the table
    eyes = Dense(str(bundle), CHECKING)
    with pytest.raises(BundleError, match="gives no embedding for a text: export"):
        eyes.scores(eyes.encode(picture(96, 72, 1)), ["grass", "a stile"])


def test_a_text_network_of_another_width_is_refused(eyes: Dense, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(TextTower, "embed", lambda _, texts: dict.fromkeys(texts, np.ones(1, np.float32)))
    with pytest.raises(BundleError, match="text network does not fit its manifest"):
        eyes.scores(eyes.encode(picture(96, 72, 1)), ["grass", "a stile"])


def test_scores_of_another_shape_are_refused(eyes: Dense, monkeypatch: pytest.MonkeyPatch) -> None:
    seen = eyes.encode(picture(96, 72, 1))

    def broken(*_: object) -> list[np.ndarray]:
        return [np.zeros((2, 64), dtype=np.float32)]

    monkeypatch.setattr("anytraverse.perception.dense.perceiver.run_session", broken)
    with pytest.raises(BundleError, match="scores network does not fit"):
        eyes.scores(seen, ["grass"])


def test_a_new_word_tells_of_its_progress_and_a_known_one_needs_none(calibrated: Path) -> None:
    told: list[str] = []
    eyes = Dense(str(calibrated), Runtime(threads=1, progress=lambda: told.append("progress")))
    seen = eyes.encode(picture(96, 72, 0))
    eyes.attend(seen, [Prompt("grass")])
    assert not told
    eyes.attend(seen, [Prompt("an upturned boat")])
    pieces = [part for part in eyes.manifest.variants["fp32"] if part.startswith("text-")]
    assert len(told) == len(pieces) * len(eyes.details.templates)
