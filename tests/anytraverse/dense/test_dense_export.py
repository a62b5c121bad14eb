"""`anytraverse export` of dense models: without a checkpoint, and what is refused."""

from __future__ import annotations

import json
import re
from pathlib import Path

import cv2
import pytest

from anytraverse.cli import main
from anytraverse.export import random_weights
from anytraverse.export.dense_making import ABSENT
from anytraverse.perception.dense.details import GROUP
from tests.anytraverse.clipseg.pictures import picture
from tests.anytraverse.dense.checkpoints import write_siglip, write_tipsv2
from tests.anytraverse.export.checkpoints import write_json

Out = pytest.CaptureFixture[str]


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Random weights of small models in place of the published ones."""
    for family in random_weights.DENSE:
        monkeypatch.setitem(random_weights.DENSE, family, random_weights.TINY_DENSE[family])
        monkeypatch.setitem(random_weights.DENSE_SIZES, family, 64)


@pytest.mark.slow
@pytest.mark.usefixtures("small")
@pytest.mark.parametrize("name", ["random-siglip2", "random-tipsv2"])
def test_random_weights_are_exported_checked_and_looked_through(
    tmp_path: Path, terrain: Path, capsys: Out, name: str
) -> None:
    out, photo = tmp_path / "bundle", tmp_path / "photo.png"
    assert main(["export", name, str(out), "--precision", "fp32,int8"]) == 0
    told = capsys.readouterr().out
    assert re.match(rf"{out}: {name}-64-[0-9a-f]{{8}}, fp32, int8, \d+ MB\n", told)
    assert "anytraverse bundle check bundle --frames FOLDER" in told
    cv2.imwrite(str(photo), picture(320, 240, 1)[..., ::-1])
    look = ["look", str(photo), "--perceiver", f"dense:{out}", "--prompts", "grass: 1; rock: -1", "--json"]
    assert main(look) != 0
    assert "is not calibrated" in capsys.readouterr().err
    assert main(["bundle", "check", str(out), "--frames", str(terrain), "--repeat", "1"]) in (0, 1)
    capsys.readouterr()
    assert main(look) == 0
    figures = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert 0 < figures["roi_uncertainty"] <= 1


@pytest.mark.usefixtures("small")
def test_templates_and_absent_words_come_from_files(tmp_path: Path) -> None:
    (tmp_path / "templates.txt").write_text("# mine\n\n {} from a rover \n{}\n")
    (tmp_path / "absent.txt").write_text("\n".join(ABSENT[:17]))
    files = ["--templates", str(tmp_path / "templates.txt"), "--absent", str(tmp_path / "absent.txt")]
    assert main(["export", "random-siglip2", str(tmp_path / "bundle"), *files]) == 0
    details = json.loads((tmp_path / "bundle/manifest.json").read_text())["details"]
    assert details["templates"] == ["{} from a rover", "{}"]
    assert details["absent"] == list(ABSENT[:17])
    assert details["calibration"] is None


@pytest.mark.usefixtures("small")
@pytest.mark.parametrize(
    ("options", "content", "reason"),
    [
        (["--size", "60"], "", "size 60 does not fit: give a multiple of 8"),
        (["--size", "2048"], "", "does not fit"),
        (["--scene", "clip-b32"], "", "has a scene embedding of its own"),
        (["--precision", "fp16"], "", 'no precision is called "fp16"'),
        (["--templates", "FILE"], "a photo", "must hold {} once"),
        (["--templates", "FILE"], "# none", "holds no line"),
        (["--templates", "FILE"], "\udcff", "cannot be read as text"),
        (["--absent", "FILE"], "piano", f"give {GROUP} to"),
        (["--absent", "nowhere"], "", "cannot be read"),
    ],
)
def test_a_refusal_is_one_line_and_code_2(
    tmp_path: Path, capsys: Out, options: list[str], content: str, reason: str
) -> None:
    file = tmp_path / "FILE"
    file.write_bytes(content.encode("utf-8", "surrogateescape"))
    given = [str(file) if option == "FILE" else option for option in options]
    assert main(["export", "random-siglip2", str(tmp_path / "bundle"), *given]) == 2
    last = capsys.readouterr().err.splitlines()[-1]
    assert last.startswith("anytraverse export: ")
    assert reason in last
    assert [path.name for path in tmp_path.iterdir()] == ["FILE"]


def test_clipseg_has_no_templates(tmp_path: Path, capsys: Out) -> None:
    (tmp_path / "templates.txt").write_text("{}")
    file = str(tmp_path / "templates.txt")
    assert main(["export", "random", str(tmp_path / "bundle"), "--templates", file]) == 2
    assert "not for CLIPSeg" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.needs_export
@pytest.mark.parametrize(
    ("changes", "reason"),
    [
        ({"vision_config": {"vision_use_head": False}}, "no pooling head"),
        ({"text_config": {"projection_size": 16}}, "no pooling head"),
        ({"vision_config": {"hidden_act": "silu"}}, 'activation "silu"'),
    ],
)
def test_another_siglip_is_refused(
    tmp_path: Path, capsys: Out, changes: dict[str, object], reason: str
) -> None:
    write_siglip(tmp_path / "checkpoint", changes)
    assert main(["export", str(tmp_path / "checkpoint"), str(tmp_path / "bundle")]) == 2
    assert reason in capsys.readouterr().err.splitlines()[-1]


@pytest.mark.slow
@pytest.mark.needs_export
def test_the_tokenizer_of_the_first_siglip_is_refused(tmp_path: Path, capsys: Out) -> None:
    from tokenizers import Tokenizer, models

    folder = write_siglip(tmp_path / "checkpoint")
    words = Tokenizer(models.Unigram([("<unk>", 0.0), ("▁", -1.0), ("a", -2.0)], 0, byte_fallback=False))
    words.save(str(folder / "tokenizer.json"))
    named = {"tokenizer_class": "PreTrainedTokenizerFast", "pad_token": "<unk>"}
    write_json(folder / "tokenizer_config.json", named)
    assert main(["export", str(folder), str(tmp_path / "bundle")]) == 2
    assert "its model is Unigram, and only BPE" in capsys.readouterr().err.splitlines()[-1]


@pytest.mark.needs_export
def test_a_tokenizer_that_the_bundle_would_not_follow_is_refused(tmp_path: Path, capsys: Out) -> None:
    folder = write_siglip(tmp_path / "checkpoint", tokenizer="GemmaTokenizer")
    path = folder / "tokenizer.json"
    backend = json.loads(path.read_text())
    backend["added_tokens"].append({**backend["added_tokens"][0], "id": 300, "content": "Mud"})
    path.write_text(json.dumps(backend))
    write_json(
        folder / "tokenizer_config.json", {"tokenizer_class": "PreTrainedTokenizerFast", "pad_token": "<pad>"}
    )
    assert main(["export", str(folder), str(tmp_path / "bundle")]) == 2
    assert "in a way that this program cannot" in capsys.readouterr().err.splitlines()[-1]


@pytest.mark.needs_export
def test_pictures_that_are_normalised_otherwise_are_refused(tmp_path: Path, capsys: Out) -> None:
    for folder in (
        write_siglip(tmp_path / "siglip", images={"do_normalize": False}),
        write_tipsv2(tmp_path / "tipsv2", images={"do_normalize": True}),
    ):
        assert main(["export", str(folder), str(tmp_path / "bundle")]) == 2
        assert "such a checkpoint cannot be exported" in capsys.readouterr().err.splitlines()[-1]


@pytest.mark.needs_export
@pytest.mark.parametrize(
    "images",
    [{"image_std": [0.5, 0.0, 0.5]}, {"image_std": [0.5] * 4}, {"image_mean": ["a", 1, 1]}, {"image_std": 1}],
)
def test_pictures_that_cannot_be_normalised_are_refused(
    tmp_path: Path, capsys: Out, images: dict[str, object]
) -> None:
    folder = write_siglip(tmp_path / "siglip", images=images)
    assert main(["export", str(folder), str(tmp_path / "bundle")]) == 2
    assert "is not as it must be" in capsys.readouterr().err.splitlines()[-1]


@pytest.mark.needs_export
def test_a_tipsv2_in_its_authors_own_format_is_refused(tmp_path: Path, capsys: Out) -> None:
    folder = write_tipsv2(tmp_path / "checkpoint")
    write_json(folder / "config.json", {"model_type": "tipsv2", "vision_fn": "vit_base", "patch_size": 14})
    assert main(["export", str(folder), str(tmp_path / "bundle")]) == 2
    assert "not in the format of transformers" in capsys.readouterr().err.splitlines()[-1]


@pytest.mark.needs_export
def test_a_checkpoint_of_another_model_is_refused(tmp_path: Path, capsys: Out) -> None:
    folder = write_siglip(tmp_path / "checkpoint")
    config = json.loads((folder / "config.json").read_text())
    write_json(folder / "config.json", {**config, "model_type": "siglip2"})
    assert main(["export", str(folder), str(tmp_path / "bundle")]) == 2
    said = capsys.readouterr().err.splitlines()[-1]
    assert '"siglip2"' in said
    assert "CIDAS/clipseg-rd64-refined" in said
    assert "google/siglip2-base-patch16-256" in said
