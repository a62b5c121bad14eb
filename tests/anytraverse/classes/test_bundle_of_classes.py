"""`anytraverse bundle classes`: a network and its names in, a bundle or one line of refusal out."""

from __future__ import annotations

import json
import re
import shutil
from collections.abc import Callable
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import onnx
import pytest
from onnx import TensorProto, helper

from anytraverse.bundle.manifest import read_manifest
from anytraverse.cli import main
from anytraverse.errors import BundleError, PerceiverError
from anytraverse.frame import Image
from anytraverse.perception import DefaultThresholds, Prompt, make_perceiver

Make = Callable[..., Path]
Out = pytest.CaptureFixture[str]
FEWER = np.eye(3, dtype=np.float32)


@pytest.fixture
def refused(network: Make, tmp_path: Path, capsys: Out) -> Callable[..., str]:
    """What the command says on stderr of a network that it refuses; it leaves nothing behind."""

    def run(
        *options: str, names: str = "grass\ndirt\nwater\n-void\n", model: Path | None = None, **wishes: Any
    ) -> str:
        (tmp_path / "names.txt").write_text(names)
        given = [str(model or network(**wishes)), str(tmp_path / "bundle"), *options]
        before = sorted(tmp_path.iterdir())
        assert main(["bundle", "classes", *given, "--names", str(tmp_path / "names.txt")]) == 2
        assert sorted(tmp_path.iterdir()) == before
        said = capsys.readouterr().err
        assert said.count("\n") == 1
        return said

    return run


def manifest(folder: Path) -> dict[str, Any]:
    values: dict[str, Any] = json.loads((folder / "manifest.json").read_text())
    return values


def test_a_network_becomes_a_bundle_that_judges_a_picture(
    bundle: Make, painted: Callable[..., Image], tmp_path: Path, capsys: Out
) -> None:
    folder = bundle("--licence", "none", "--source", "painted by hand")
    told = capsys.readouterr().out
    assert "grass, dirt, water (1 ignored)" in told
    assert "32x24 nchw float32 rgb" in told
    assert "taps cannot teach" in told
    assert f'look PICTURE --perceiver classes:{folder} --prompts "grass: 1"' in told
    photo = tmp_path / "photo.png"
    cv2.imwrite(str(photo), painted("grass", "dirt", "dirt", "grass")[..., ::-1])
    look = ["look", str(photo), "--perceiver", f"classes:{folder}", "--json"]
    assert main([*look, "--prompts", "lawn: 1"]) == 0
    assert json.loads(capsys.readouterr().out.splitlines()[-1])["reasons"] == ["unknown_object"]
    assert main([*look, "--prompts", "lawn: 1; trail: 0.8"]) == 0
    figures = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert figures["reasons"] == []
    assert figures["roi_traversability"] > 0.75
    assert main([*look, "--prompts", "lwan: 1"]) == 2
    assert re.search(r'"lwan" is not a word .*: (grass|water),', capsys.readouterr().err)


def test_the_manifest_says_what_was_found_in_the_network(bundle: Make) -> None:
    values = manifest(bundle("--thresholds", "roi=0.2,tile=none", "--filter", "bicubic", "--name", "My net!"))
    assert values["kind"] == "classes"
    assert values["image"] == {"width": 32, "height": 24, "filter": "bicubic", "crop": False}
    assert values["thresholds"] == {"roi": 0.2, "scene": 0.75, "tile": None}
    assert values["variants"] == {"fp32": {"image": "network.onnx"}}
    assert re.fullmatch(r"classes-my-net-[0-9a-f]{12}", values["model_id"])
    details = values["details"]
    assert details["classes"][0] == {"name": "grass", "synonyms": ["lawn", "green grass"]}
    assert details["ignore"] == ["void"]
    assert (details["activation"], details["output"]) == ("softmax", "scores")
    assert details["input"]["layout"] == "nchw"


def test_imagenets_normalisation_is_assumed_where_nothing_is_said(network: Make, tmp_path: Path) -> None:
    (tmp_path / "names.txt").write_text("a\nb\nc\nd\n")
    out = tmp_path / "out"
    assert main(["bundle", "classes", str(network()), str(out), "--names", str(tmp_path / "names.txt")]) == 0
    assert manifest(out)["details"]["input"]["mean"] == [0.485, 0.456, 0.406]


def test_other_names_or_another_normalisation_are_another_model(bundle: Make) -> None:
    first = manifest(bundle())["model_id"]
    assert manifest(bundle())["model_id"] == first
    assert manifest(bundle(names="grass\ndirt\nwater\nvoid"))["model_id"] != first
    assert manifest(bundle("--std", "1,1,0.5"))["model_id"] != first


@pytest.mark.parametrize(
    ("options", "wishes", "activation"),
    [
        ((), {"then": "Softmax"}, "probabilities"),
        ((), {"then": "Sigmoid"}, "none"),
        (("--activation", "sigmoid"), {}, "sigmoid"),
        ((), {"names": "grass", "scores": FEWER[:1] * 9 - 5}, "sigmoid"),
    ],
)
def test_what_is_left_to_be_done_to_the_scores_is_found_out(
    bundle: Make, options: tuple[str, ...], wishes: dict[str, Any], activation: str
) -> None:
    assert manifest(bundle(*options, **wishes))["details"]["activation"] == activation


def test_features_let_taps_teach(bundle: Make, capsys: Out) -> None:
    bundle(features=1.0)
    assert "3 channels: taps can teach" in capsys.readouterr().out


def test_the_bundle_passes_its_check(bundle: Make, capsys: Out) -> None:
    folder = bundle()
    capsys.readouterr()
    assert main(["bundle", "check", str(folder), "--repeat", "1", "--json"]) == 0
    assert json.loads(capsys.readouterr().out.splitlines()[-1])["kind"] == "classes"


@pytest.mark.parametrize(
    ("options", "wishes", "said"),
    [
        ((), {"names": "grass\ndirt\nwater"}, "3 class names, but the network gives 4 maps"),
        ((), {"names": "a\nb\nc\nd\ne"}, "5 class names, but the network gives 4 maps"),
        ((), {"then": "ArgMax"}, "without its final argmax"),
        ((), {"shape": (1, 3, "h", "w")}, "--size WxH"),
        (("--size", "64x48"), {}, "1x3x24x32, not 64x48"),
        ((), {"shape": (1, "c", 24, "d")}, "--layout nchw or nhwc"),
        (("--layout", "nhwc"), {}, "not nhwc"),
        ((), {"shape": (2, 3, 24, 32)}, "one picture"),
        ((), {"dtype": TensorProto.FLOAT16}, "float16"),
        (("--output", "logits"), {}, "choose scores"),
        (("--activation", "softmax"), {"then": "Softmax"}, "sum to 1 already"),
        (("--activation", "none"), {}, "not none"),
        (("--activation", "probabilities"), {"then": "Sigmoid"}, "do not sum to 1"),
        (("--activation", "softmax"), {"names": "grass", "scores": FEWER[:1]}, "single class"),
        (("--mean", "123.7,116.3,103.5"), {}, "--scale 1"),
        (("--scale", "0"), {}, "above 0"),
        (("--scale", "1"), {"dtype": TensorProto.UINT8}, "leave --mean, --std and --scale out"),
        (("--size", "9999x20"), {"shape": (1, 3, "h", "w")}, "1 to 4096"),
        ((), {"scores": np.full((4, 3), np.nan, dtype=np.float32)}, "not finite"),
    ],
)
def test_a_network_that_does_not_fit_is_refused(
    refused: Callable[..., str], options: tuple[str, ...], wishes: dict[str, Any], said: str
) -> None:
    assert re.search(said, refused(*options, **wishes))


@pytest.mark.parametrize(
    ("names", "said"),
    [
        ("grass\ndirt\nwater, lawn\ngrass", '"grass" stands twice, for class 0'),
        ("grass, lawn\ndirt, lawn\nwater\nvoid", '"lawn" stands twice'),
        ("grass\ndirt: brown\nwater\nvoid", "line 2"),
        ("grass\n\n# more\ndirt, , brown\nwater\nvoid", "line 4: a word is empty"),
        ("-a\n-b\n-c\n-d", "no class is a word"),
        ("\n", "no class is a word"),
    ],
)
def test_names_that_cannot_be_are_refused_with_their_line(
    refused: Callable[..., str], names: str, said: str
) -> None:
    assert said in refused(names=names)


def test_names_that_are_no_text_are_refused(network: Make, tmp_path: Path, capsys: Out) -> None:
    names = tmp_path / "names.txt"
    for data in (b"\xff\xfe\x00", b"a" * (1 << 20) + b"a"):
        names.write_bytes(data)
        assert main(["bundle", "classes", str(network()), str(tmp_path / "out"), "--names", str(names)]) == 2
        assert "one class a line" in capsys.readouterr().err


@pytest.fixture
def split(network: Make, tmp_path: Path) -> Make:
    """A network whose weights stand in another file, of this name."""

    def save(weights: str) -> Path:
        (tmp_path / "split").mkdir()
        path = tmp_path / "split/split.onnx"
        whole = onnx.load(network())
        onnx.save(whole, str(path), save_as_external_data=True, location=weights, size_threshold=0)
        assert (tmp_path / "split" / weights).exists()
        return path

    return save


def test_weights_in_a_file_beside_the_network_come_along(
    split: Make, tmp_path: Path, painted: Callable[..., Image]
) -> None:
    model, out = split("split.onnx.data"), tmp_path / "out"
    (tmp_path / "names.txt").write_text("grass\ndirt\nwater\nvoid")
    options = ["--names", str(tmp_path / "names.txt"), "--mean", "0,0,0"]
    assert main(["bundle", "classes", str(model), str(out), *options]) == 0
    shutil.rmtree(tmp_path / "split")
    perceiver = make_perceiver(f"classes:{out}")
    grass = perceiver.attend(perceiver.encode(painted("grass")), [Prompt("grass")])
    assert grass.min() > 0.95
    data = bytearray((out / "split.onnx.data").read_bytes())
    data[0] ^= 1
    (out / "split.onnx.data").write_bytes(data)
    with pytest.raises(BundleError, match="torn"):
        make_perceiver(f"classes:{out}")


def test_weights_in_a_file_of_another_name_are_refused(refused: Callable[..., str], split: Make) -> None:
    assert "make it one file" in refused(model=split("weights"))


def test_what_is_no_network_is_refused(refused: Callable[..., str], tmp_path: Path) -> None:
    (tmp_path / "torn.onnx").write_bytes(b"no network")
    assert "cannot load network.onnx" in refused(model=tmp_path / "torn.onnx")
    assert "missing.onnx" in refused(model=tmp_path / "missing.onnx")


def test_a_network_of_two_inputs_is_refused(refused: Callable[..., str], tmp_path: Path) -> None:
    inputs = [helper.make_tensor_value_info(name, TensorProto.FLOAT, [1, 3, 8, 8]) for name in "ab"]
    output = helper.make_tensor_value_info("c", TensorProto.FLOAT, None)
    graph = helper.make_graph([helper.make_node("Add", ["a", "b"], ["c"])], "two", inputs, [output])
    path = tmp_path / "two.onnx"
    onnx.save(helper.make_model(graph, opset_imports=[helper.make_opsetid("", 13)], ir_version=8), str(path))
    assert "inputs a, b" in refused(model=path)


@pytest.mark.parametrize("size", ["32", "32x", "0x0x0", "axb"])
def test_a_size_that_is_none_is_refused(size: str, capsys: Out) -> None:
    with pytest.raises(SystemExit):
        main(["bundle", "classes", "m", "o", "--names", "n", "--size", size])
    assert "WIDTHxHEIGHT" in capsys.readouterr().err


def test_the_tiles_that_a_threshold_is_meant_for_are_written_and_read(bundle: Make) -> None:
    folder = bundle("--thresholds", "tile=0.9,tile_share=0.08")
    assert manifest(folder)["thresholds"] == {"roi": 0.3, "scene": 0.75, "tile": 0.9, "tile_share": 0.08}
    assert read_manifest(folder).thresholds == DefaultThresholds(0.3, 0.75, 0.9, tile_share=0.08)


@pytest.mark.parametrize("given", ["tile_share=0", "roi=2", "roof=0.3", "scene", "roi=nan", "scene=none"])
def test_thresholds_that_are_none_are_refused(given: str, capsys: Out) -> None:
    with pytest.raises(SystemExit):
        main(["bundle", "classes", "m", "o", "--names", "n", "--thresholds", given])
    assert "write e.g. roi=0.3,scene=0.75,tile=0.5" in capsys.readouterr().err


def test_a_torn_network_is_refused(bundle: Make) -> None:
    folder = bundle()
    data = bytearray((folder / "network.onnx").read_bytes())
    data[len(data) // 2] ^= 1
    (folder / "network.onnx").write_bytes(data)
    with pytest.raises(BundleError, match="torn"):
        make_perceiver(f"classes:{folder}")


def test_another_kinds_bundle_is_refused(bundle: Make, reseal: Callable[..., None]) -> None:
    folder = bundle()
    reseal(folder, lambda values: values.update(kind="clipseg"))
    with pytest.raises(BundleError, match='of kind "clipseg"'):
        make_perceiver(f"classes:{folder}")


def test_a_bundle_whose_names_do_not_fit_its_network_is_refused_with_both_numbers(
    bundle: Make, reseal: Callable[..., None]
) -> None:
    folder = bundle()
    reseal(folder, lambda values: values["details"]["classes"].insert(0, {"name": "mud", "synonyms": []}))
    with pytest.raises(BundleError, match="5 class names, but the network gives 4"):
        make_perceiver(f"classes:{folder}")


def test_a_bundle_that_would_crop_frames_is_refused(bundle: Make, reseal: Callable[..., None]) -> None:
    folder = bundle()
    reseal(folder, lambda values: values["image"].update(width=24, crop=True))
    with pytest.raises(BundleError, match="cropped"):
        make_perceiver(f"classes:{folder}")


def test_classes_alone_name_no_bundle() -> None:
    with pytest.raises(PerceiverError, match="classes:FOLDER"):
        make_perceiver("classes")
