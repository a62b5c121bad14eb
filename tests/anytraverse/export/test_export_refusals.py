"""Checkpoints that are torn, foreign or odd: refused with what to do, and nothing is left behind."""

from __future__ import annotations

import json
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from anytraverse.errors import BundleError
from anytraverse.export import export_bundle
from anytraverse.perception import Prompt, make_perceiver
from tests.anytraverse.clipseg.pictures import picture
from tests.anytraverse.export.checkpoints import write_clip, write_clipseg

pytestmark = pytest.mark.needs_export

WEIGHTS = "model.safetensors"
Damage = Callable[[Path], None]


@pytest.fixture(scope="module")
def sound(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with two checkpoints, clipseg and clip."""
    folder = tmp_path_factory.mktemp("sound")
    write_clipseg(folder / "clipseg", {})
    write_clip(folder / "clip", {})
    for name in ("vocab.json", "merges.txt"):
        shutil.copy(folder / "clipseg" / name, folder / "clip")
    return folder


@pytest.fixture
def checkpoint(sound: Path, tmp_path: Path) -> Path:
    """A checkpoint to be damaged."""
    return Path(shutil.copytree(sound / "clipseg", tmp_path / "checkpoint"))


def refusal(checkpoint: Path, **options: Any) -> str:
    """Why it is refused. Beside it nothing is left."""
    before = sorted(checkpoint.parent.iterdir())
    with pytest.raises(BundleError) as refused:
        export_bundle(str(checkpoint), checkpoint.parent / "bundle", **{"size": 96, **options})
    assert sorted(checkpoint.parent.iterdir()) == before
    return str(refused.value)


def change_json(name: str, **values: Any) -> Damage:
    """Sets keys; None removes one; "a.b" is the key b in a."""

    def change(folder: Path) -> None:
        content = json.loads((folder / name).read_text())
        for path, value in values.items():
            *outer, key = path.split("__")
            inner = content
            for each in outer:
                inner = inner[each]
            inner.pop(key, None)
            if value is not None:
                inner[key] = value
        (folder / name).write_text(json.dumps(content))

    return change


def change_weights(change: Callable[[dict[str, Any]], None]) -> Damage:
    def apply(folder: Path) -> None:
        from safetensors.numpy import load_file, save_file

        weights = load_file(folder / WEIGHTS)
        change(weights)
        save_file(weights, folder / WEIGHTS, metadata={"format": "pt"})

    return apply


def drop_decoder(weights: dict[str, Any]) -> None:
    for name in [name for name in weights if name.startswith("decoder.")]:
        del weights[name]


def spoil(weights: dict[str, Any]) -> None:
    weights["decoder.film_mul.weight"][0, 0] = np.nan


def reshape(weights: dict[str, Any]) -> None:
    weights["decoder.film_mul.bias"] = np.zeros(7, dtype=np.float32)


def tear(name: str) -> Damage:
    def cut(folder: Path) -> None:
        data = (folder / name).read_bytes()
        (folder / name).write_bytes(data[: len(data) // 2])

    return cut


def cut_lines(name: str) -> Damage:
    def cut(folder: Path) -> None:
        lines = (folder / name).read_text(encoding="utf-8").splitlines(keepends=True)
        (folder / name).write_text("".join(lines[: len(lines) // 2]), encoding="utf-8")

    return cut


def remove(*names: str) -> Damage:
    def gone(folder: Path) -> None:
        for name in names:
            (folder / name).unlink()

    return gone


PIXELS, CONFIG = "preprocessor_config.json", "config.json"
REFUSED = {
    "no weights": (
        remove(WEIGHTS),
        "lacks model.safetensors or pytorch_model.bin: copy the whole checkpoint",
    ),
    "no config": (remove(CONFIG), "lacks config.json"),
    "no preprocessor": (remove(PIXELS), "lacks preprocessor_config.json"),
    "no tokenizer": (remove("vocab.json", "merges.txt"), "lacks vocab.json, merges.txt"),
    "no merges": (remove("merges.txt"), "lacks merges.txt"),
    "torn weights": (tear(WEIGHTS), "cannot be loaded"),
    "torn config": (tear(CONFIG), "config.json cannot be read"),
    "torn preprocessor": (tear(PIXELS), "preprocessor_config.json cannot be read"),
    "torn vocabulary": (tear("vocab.json"), "the tokenizer in"),
    "torn merges": (tear("merges.txt"), "the tokenizer in"),
    "merges cut at the end of a line": (cut_lines("merges.txt"), "merges.txt is torn"),
    "a list for a config": (lambda folder: (folder / CONFIG).write_text("[]"), "holds no JSON object"),
    "no decoder": (change_weights(drop_decoder), "lacks weights (decoder."),
    "weights that are not finite": (change_weights(spoil), "decoder.film_mul.weight is not finite"),
    "weights of another shape": (change_weights(reshape), "cannot be loaded"),
    "a config of other sizes": (change_json(CONFIG, reduce_dim=32), "cannot be loaded"),
    "a config of nonsense": (change_json(CONFIG, reduce_dim="many"), "copy"),
    "layers that are not there": (change_json(CONFIG, extract_layers=[0, 1, 9]), "no such CLIPSeg"),
    "no words anywhere": (change_json(CONFIG, conditional_layer=3), "no such CLIPSeg"),
    "an unknown activation": (
        change_json(CONFIG, vision_config__hidden_act="gelu_new"),
        'the activation "gelu_new" cannot be exported',
    ),
    "another end of text": (change_json(CONFIG, text_config__eos_token_id=7), "ends a text with token 7"),
    "no mean": (change_json(PIXELS, image_mean=None), "is not as it must be (KeyError: 'image_mean')"),
    "a grey mean": (change_json(PIXELS, image_mean=[0.5]), "is not as it must be"),
    "an unknown filter": (change_json(PIXELS, resample=0), "resizes with filter 0"),
    "pixels as they are": (change_json(PIXELS, do_normalize=False), "leaves pixels unscaled"),
    "pixels of another scale": (change_json(PIXELS, rescale_factor=1 / 127.5), "leaves pixels unscaled"),
}


@pytest.mark.parametrize(("damage", "expected"), REFUSED.values(), ids=REFUSED)
def test_what_cannot_be_right_is_refused(checkpoint: Path, damage: Damage, expected: str) -> None:
    damage(checkpoint)
    assert expected in refusal(checkpoint)


def test_another_model_is_refused_by_name(sound: Path, tmp_path: Path) -> None:
    with pytest.raises(
        BundleError, match='is a checkpoint of "clip", which cannot be exported: give one like CIDAS/'
    ):
        export_bundle(str(sound / "clip"), tmp_path / "bundle")
    with pytest.raises(BundleError, match='is a checkpoint of "clipseg", not of clip: give one like openai/'):
        export_bundle(
            str(sound / "clipseg"), tmp_path / "bundle", scene="clip-b32", clip=str(sound / "clipseg")
        )
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize("size", [90, 0, -96, 16, 1040, 100_000])
def test_a_size_that_does_not_fit_the_patches_is_refused(checkpoint: Path, size: int) -> None:
    assert "give a multiple of 16 from 32 to 1024" in refusal(checkpoint, size=size)


@pytest.mark.parametrize(
    ("options", "expected"),
    [
        ({"precisions": ["fp32", "fp16"]}, 'no precision is called "fp16": choose from fp32, int8'),
        ({"scene": "b32"}, 'no scene embedding is called "b32": choose shared or clip-b32'),
    ],
)
def test_what_was_misspelt_is_said_before_the_checkpoint_is_read(
    options: dict[str, Any], expected: str
) -> None:
    said: list[str] = []
    with pytest.raises(BundleError, match=expected):
        export_bundle("CIDAS/clipseg-rd64-refined", Path("nowhere"), say=said.append, **options)
    assert said == []


def test_a_place_that_is_taken_is_refused_before_the_checkpoint_is_read(tmp_path: Path) -> None:
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/thesis.tex").write_text("years of work")
    said: list[str] = []
    with pytest.raises(BundleError, match="exists and is not a bundle"):
        export_bundle("CIDAS/clipseg-rd64-refined", tmp_path / "mine", say=said.append)
    assert said == []
    assert (tmp_path / "mine/thesis.tex").read_text() == "years of work"


@pytest.mark.parametrize("moment", ["reading", "writing image", "writing text-1", "tokens.npy"])
def test_ctrl_c_leaves_nothing_and_an_older_bundle_as_it_was(
    checkpoint: Path, tmp_path: Path, moment: str
) -> None:
    out = tmp_path / "bundle"
    model_id = export_bundle(str(checkpoint), out, size=64).model_id
    before = sorted(tmp_path.iterdir())

    def interrupt(line: str) -> None:
        if line.startswith(moment):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        export_bundle(str(checkpoint), out, size=96, say=interrupt)
    assert sorted(tmp_path.iterdir()) == before
    assert make_perceiver(f"clipseg:{out}").model_id == model_id


def test_without_transformers_it_is_said_what_to_install(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setitem(sys.modules, "transformers", None)
    with pytest.raises(
        BundleError, match=r'needs transformers: .* pip install "anytraverse-companion\[export\]"'
    ):
        export_bundle("CIDAS/clipseg-rd64-refined", tmp_path / "bundle")


def test_older_weight_files_give_the_same_bundle(checkpoint: Path, tmp_path: Path) -> None:
    import torch
    from safetensors.torch import load_file

    first = export_bundle(str(checkpoint), tmp_path / "first", size=96).model_id
    torch.save(load_file(checkpoint / WEIGHTS), checkpoint / "pytorch_model.bin")
    (checkpoint / WEIGHTS).unlink()
    assert export_bundle(str(checkpoint), tmp_path / "second", size=96).model_id == first


def test_weights_of_half_precision_are_exported_as_they_are(checkpoint: Path, tmp_path: Path) -> None:
    frame, prompts = picture(96, 96, 1), [Prompt("grass"), Prompt("mud")]
    maps = []

    def halve(weights: dict[str, Any]) -> None:
        weights.update({name: value.astype(np.float16) for name, value in weights.items()})

    for name, change in (("full", lambda _: None), ("half", change_weights(halve))):
        change(checkpoint)
        export_bundle(str(checkpoint), tmp_path / name, size=96)
        eyes = make_perceiver(f"clipseg:{tmp_path / name}")
        maps.append(eyes.attend(eyes.encode(frame), prompts))
    assert 0 < np.abs(maps[0] - maps[1]).max() < 0.05


def test_a_tokenizer_in_one_file_is_read_too(checkpoint: Path, tmp_path: Path) -> None:
    from transformers import CLIPTokenizerFast

    first = export_bundle(str(checkpoint), tmp_path / "first", size=96)
    CLIPTokenizerFast.from_pretrained(checkpoint).backend_tokenizer.save(str(checkpoint / "tokenizer.json"))
    for name in ("vocab.json", "merges.txt"):
        (checkpoint / name).unlink()
    second = export_bundle(str(checkpoint), tmp_path / "second", size=96)
    assert second.files["tokenizer.json"] == first.files["tokenizer.json"]


def test_what_is_known_of_the_weights_is_in_the_bundle(checkpoint: Path, sound: Path, tmp_path: Path) -> None:
    (checkpoint / "README.md").write_text("---\nlicense: mit\n---\n")
    manifest = export_bundle(
        str(checkpoint), tmp_path / "bundle", size=96, scene="clip-b32", clip=str(sound / "clip"), name="mine"
    )
    assert manifest.name == "mine"
    assert manifest.source["licence"] == "mit"
    assert manifest.source["weights"] == "checkpoint"
    assert manifest.source["scene_weights"] == "clip"
    assert "see its page" in manifest.source["scene_licence"]
