"""Bundles of CLIPSeg: made, torn, foreign, spoilt, and how they are run."""

from __future__ import annotations

import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from anytraverse.bundle.manifest import Manifest, read_manifest
from anytraverse.bundle.records import CheckRuntime
from anytraverse.errors import BundleError, PerceiverError
from anytraverse.export.making import make_bundle
from anytraverse.export.random_weights import TINY, random_clipseg, random_scene
from anytraverse.perception import Prompt, make_perceiver
from anytraverse.perception.clipseg.perceiver import ClipSeg
from anytraverse.perception.runtime import Runtime
from tests.anytraverse.clipseg.conftest import TINY_SCENE
from tests.anytraverse.clipseg.pictures import picture

ONE = Runtime(threads=1)
INT8 = CheckRuntime(threads=1, precision="int8")


@pytest.fixture
def copy(tiny: Path, tmp_path: Path) -> Path:
    """A bundle to be damaged."""
    return Path(shutil.copytree(tiny, tmp_path / "copy"))


def flip(path: Path) -> None:
    data = bytearray(path.read_bytes())
    data[len(data) // 2] ^= 1
    path.write_bytes(data)


def see(eyes: ClipSeg) -> None:
    features = eyes.encode(picture(64, 64, 1))
    eyes.attend(features, [Prompt("grass")])
    eyes.embed(features)


def ids_of(*manifests: Manifest) -> set[str]:
    return {manifest.model_id for manifest in manifests}


def test_the_same_weights_are_the_same_model_and_others_another(tmp_path: Path) -> None:
    first, second, other = (
        make_bundle(tmp_path / str(number), random_clipseg(TINY, seed=seed), size=64)
        for number, seed in enumerate((0, 0, 1))
    )
    assert first.model_id == second.model_id
    assert first.files == second.files
    assert other.model_id != first.model_id


def test_size_and_scene_make_another_model_and_precision_does_not(tmp_path: Path) -> None:
    checkpoint = random_clipseg(TINY)
    plain = make_bundle(tmp_path / "plain", checkpoint, size=64)
    wide = make_bundle(tmp_path / "wide", checkpoint, size=96)
    scene = make_bundle(tmp_path / "scene", checkpoint, size=64, scene=random_scene(TINY_SCENE, joint=20))
    int8 = make_bundle(tmp_path / "int8", checkpoint, size=64, precisions=["int8"])
    assert len(ids_of(plain, wide, scene)) == 3
    assert plain.model_id == int8.model_id
    assert (plain.scene, scene.scene) == ("shared", "clip-b32")
    assert plain.thresholds.scene < scene.thresholds.scene
    assert set(int8.variants) == {"fp32", "int8"}


def test_weights_that_are_not_finite_are_refused(tmp_path: Path) -> None:
    checkpoint, scene = random_clipseg(TINY), random_scene(TINY_SCENE, joint=20)
    for weights in (checkpoint.weights, scene.weights):
        name = next(name for name in weights if name.endswith("layers.1.mlp.fc1.bias"))
        kept = weights[name].copy()
        weights[name][3] = np.inf
        with pytest.raises(BundleError, match=f"the checkpoint's {name} is not finite"):
            make_bundle(tmp_path / "bundle", checkpoint, size=64, scene=scene)
        weights[name][...] = kept
    doubled = replace(
        checkpoint, weights={name: each.astype(np.float64) for name, each in checkpoint.weights.items()}
    )
    with pytest.raises(BundleError, match="float64: give them as float32"):
        make_bundle(tmp_path / "bundle", doubled, size=64)
    assert list(tmp_path.iterdir()) == []


def test_a_tokenizer_of_another_network_is_refused(tmp_path: Path) -> None:
    checkpoint = random_clipseg(TINY)
    for content, reason in (
        (checkpoint.tokenizer.replace("513", "514"), "they do not belong together"),
        (checkpoint.tokenizer.replace('"NFC"', '"StripAccents"'), r"cannot be used: .*StripAccents"),
        ("{}", "tokenizer cannot be used"),
    ):
        with pytest.raises(BundleError, match=reason):
            make_bundle(tmp_path / "bundle", replace(checkpoint, tokenizer=content), size=64)


def test_a_byte_changed_in_any_file_is_found_before_it_runs(copy: Path) -> None:
    manifest = read_manifest(copy)
    for name in manifest.files:
        runtime = INT8 if "int8" in name else ONE
        flip(copy / name)
        with pytest.raises(BundleError, match=f"{name} is torn"):
            ClipSeg(str(copy), runtime)
        flip(copy / name)
    for runtime in (ONE, INT8):
        ClipSeg(str(copy), runtime)


def test_a_torn_int8_does_not_keep_fp32_from_running(copy: Path) -> None:
    flip(copy / "image.int8.weights")
    assert ClipSeg(str(copy), ONE).precision == "fp32"


@pytest.mark.parametrize(
    "name", ["image.weights", "text-2.onnx", "tokens.npy", "tokenizer.json", "manifest.json"]
)
def test_a_file_that_is_not_there_is_named(copy: Path, name: str) -> None:
    (copy / name).unlink()
    with pytest.raises(BundleError, match=name):
        ClipSeg(str(copy), ONE)


def test_a_bundle_of_another_kind_is_refused_with_its_own(copy: Path) -> None:
    text = (copy / "manifest.json").read_text()
    (copy / "manifest.json").write_text(text.replace('"kind": "clipseg"', '"kind": "classes"'))
    with pytest.raises(BundleError, match=r'of kind "classes", not "clipseg": give it as classes:'):
        make_perceiver(f"clipseg:{copy}")


@pytest.mark.parametrize(
    ("name", "reason"),
    [
        ("clipseg", 'write "clipseg:FOLDER"'),
        ("clipseg:", "FOLDER"),
        ("clipseg:/no/such/folder", "is not a bundle"),
    ],
)
def test_no_bundle_at_all_is_said_so(name: str, reason: str) -> None:
    with pytest.raises(PerceiverError, match=reason):
        make_perceiver(name)


def test_a_provider_that_is_missing_is_named_beside_those_that_are_there(tiny: Path) -> None:
    with pytest.raises(PerceiverError, match=r"no provider TensorRT here, only .*CPU.*onnxruntime-gpu"):
        ClipSeg(str(tiny), Runtime(providers=("TensorRT", "CPU")))


def test_int8_is_refused_until_a_check_has_passed_it_and_auto_says_why(tiny: Path) -> None:
    with pytest.raises(BundleError, match=r"int8 must not run here: .*not checked on this machine"):
        ClipSeg(str(tiny), Runtime(threads=1, precision="int8"))
    eyes = ClipSeg(str(tiny), Runtime(threads=1, precision="auto"))
    assert (eyes.precision, "anytraverse bundle check" in eyes.why) == ("fp32", True)


def test_int8_sees_nearly_what_fp32_sees(tiny: Path) -> None:
    frame, words = picture(64, 64, 1), [Prompt("grass"), Prompt("mud")]
    fp32, int8 = ClipSeg(str(tiny), ONE), ClipSeg(str(tiny), INT8)
    assert int8.model_id == fp32.model_id
    first, second = fp32.encode(frame), int8.encode(frame)
    assert float(fp32.embed(first) @ int8.embed(second)) > 0.99
    difference = np.abs(fp32.attend(first, words) - int8.attend(second, words))
    assert 0 < difference.mean() < 0.05


@pytest.mark.parametrize("threads", [1, 2])
def test_networks_get_the_cores_they_are_given_and_do_not_spin(tiny: Path, threads: int) -> None:
    eyes = ClipSeg(str(tiny), Runtime(threads=threads))
    options = eyes._image.get_session_options()
    assert options.intra_op_num_threads == threads
    assert options.get_session_config_entry("session.force_spinning_stop") == "1"
    maps = eyes.attend(eyes.encode(picture(64, 64, 1)), [Prompt("grass")])
    one = ClipSeg(str(tiny), ONE)
    np.testing.assert_allclose(maps, one.attend(one.encode(picture(64, 64, 1)), [Prompt("grass")]), atol=1e-5)


@pytest.mark.parametrize(
    ("weight", "reason"),
    [
        ("decoder.reduces.1.weight", "the image network's output is not finite"),
        ("clip.vision_model.encoder.layers.0.mlp.fc1.weight", "the image network's output is not finite"),
        ("clip.text_projection.weight", 'the text network gave no finite answer for "grass"'),
        ("decoder.film_add.weight", "the decoder's output is not finite"),
        ("decoder.transposed_convolution.4.weight", "the decoder's output is not finite"),
        ("clip.visual_projection.weight", "the scene's embedding is not finite"),
    ],
)
def test_numbers_that_are_not_finite_never_come_out(tmp_path: Path, weight: str, reason: str) -> None:
    checkpoint = random_clipseg(TINY)
    checkpoint.weights[weight][...] = np.where(checkpoint.weights[weight] < 0, -3e38, 3e38)
    make_bundle(tmp_path / "bundle", checkpoint, size=64)
    eyes = ClipSeg(str(tmp_path / "bundle"), ONE)
    with pytest.raises(PerceiverError, match=reason):
        see(eyes)


def test_a_few_logits_that_are_no_numbers_do_not_hide_among_the_others(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("anytraverse.export.making.check_weights", lambda _: None)
    checkpoint = random_clipseg(TINY)
    checkpoint.weights["decoder.transposed_convolution.4.weight"][0, 0, 1, 2] = np.nan  # one of 16 pixels
    make_bundle(tmp_path / "bundle", checkpoint, size=64)
    eyes = ClipSeg(str(tmp_path / "bundle"), ONE)
    with pytest.raises(PerceiverError, match="the decoder's output is not finite"):
        eyes.attend(eyes.encode(picture(64, 64, 1)), [Prompt("grass")])
