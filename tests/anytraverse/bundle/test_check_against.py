"""`anytraverse bundle check --against`: what a bundle loses against a larger one, on the same frames."""

from __future__ import annotations

import json
from collections.abc import Callable
from hashlib import sha256
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from anytraverse.bundle.against import SizeComparison
from anytraverse.bundle.comparing import TimedOutputs
from anytraverse.cli import main
from anytraverse.errors import PerceiverError

MakeBundle = Callable[..., Path]
Out = pytest.CaptureFixture[str]

SCENE = np.array([1.0, 0.0], dtype=np.float32)


def block(side: int, share: float) -> TimedOutputs:
    """A map of side x side, sure in this share of its columns, from the left."""
    maps = np.full((1, side, side), 0.2, dtype=np.float32)
    maps[:, :, : round(side * share)] = 0.8
    return TimedOutputs(maps, SCENE, 1.0)


def hashes(folder: Path) -> dict[str, str]:
    """Every file below the folder, and what it holds."""
    files = [path for path in folder.rglob("*") if path.is_file()]
    return {str(path.relative_to(folder)): sha256(path.read_bytes()).hexdigest() for path in files}


@pytest.mark.parametrize(("reference", "other"), [(40, 20), (20, 40)])
def test_the_smaller_map_is_enlarged_whichever_it_is(reference: int, other: int) -> None:
    comparison = SizeComparison(["grass"])
    comparison.add(block(reference, 0.5), block(other, 0.5))
    assert comparison.by_word == {"grass": (1, 1.0)}


def test_what_a_coarse_map_misses_is_in_the_iou_of_its_word() -> None:
    comparison = SizeComparison(["grass"])
    comparison.add(block(40, 0.5), block(20, 0.4))
    assert comparison.by_word["grass"][1] == pytest.approx(0.8, abs=0.01)


def test_the_mean_in_the_roi_is_taken_at_each_maps_own_size() -> None:
    comparison = SizeComparison(["grass"])
    comparison.add(block(60, 0.5), block(30, 0.4))
    (reference, other) = comparison.attention["grass"][0]
    assert reference == pytest.approx(0.5)  # the ROI is from 1/3 to 2/3: half of it is sure
    assert other == pytest.approx(0.32)


def test_a_map_in_which_the_roi_has_no_pixel_is_refused() -> None:
    with pytest.raises(PerceiverError, match="too small"):
        SizeComparison(["grass"]).add(block(40, 0.5), block(2, 0.5))


def test_a_number_that_is_not_finite_fails() -> None:
    broken = block(20, 0.5)
    broken.maps[0, 0, 0] = np.nan
    comparison = SizeComparison(["grass"])
    comparison.add(block(40, 0.5), broken)
    assert "not finite" in comparison.failure
    assert comparison.masks == 0


@pytest.mark.usefixtures("sham")
class TestCommand:
    """With a perceiver that needs no network."""

    def test_it_writes_nothing_and_tells_each_word(
        self, make_bundle: MakeBundle, frames: Path, capsys: Out
    ) -> None:
        small, big = make_bundle("small", gain=4.0, shift=4), make_bundle("big")
        before = hashes(small), hashes(big)
        command = ["bundle", "check", str(small), "--against", str(big), "--frames", str(frames)]
        assert main([*command, "--precision", "int8", "--json"]) == 0
        found: dict[str, Any] = json.loads(capsys.readouterr().out)
        assert (hashes(small), hashes(big)) == before
        assert found["frames"] == 12
        assert found["words"]["red"]["masks"] == 12
        assert 0.6 < found["words"]["red"]["iou"] < 0.9  # 20 to 31 of 64 columns, 4 to the right
        assert found["words"]["green"]["iou"] == 1.0  # rows, which a shift to the right leaves alone
        assert found["words"]["red"]["roi_difference"] > 0.0
        assert found["gain"] == pytest.approx(4.0)
        assert main([*command, "--precision", "int8"]) == 0
        said = capsys.readouterr().out
        assert "25 ms a frame against 100 ms, 4.0 times as fast, by CPU time" in said
        assert "NOTE" not in said

    def test_without_frames_it_says_what_to_give(self, make_bundle: MakeBundle, capsys: Out) -> None:
        small, big = make_bundle("small"), make_bundle("big")
        assert main(["bundle", "check", str(small), "--against", str(big)]) == 2
        assert "--frames FOLDER" in capsys.readouterr().err

    @pytest.mark.parametrize(
        ("flaw", "why"), [({"fails": True}, "network failed"), ({"nan": True}, "finite")]
    )
    def test_a_bundle_that_fails_is_refused(
        self, make_bundle: MakeBundle, frames: Path, capsys: Out, flaw: dict[str, Any], why: str
    ) -> None:
        small, big = make_bundle("small", **flaw), make_bundle("big")
        command = ["bundle", "check", str(small), "--against", str(big), "--frames", str(frames)]
        assert main([*command, "--precision", "int8"]) == 2
        assert why in capsys.readouterr().err

    def test_words_without_masks_are_told(self, make_bundle: MakeBundle, frames: Path, capsys: Out) -> None:
        small, big = make_bundle("small"), make_bundle("big")
        for file in frames.iterdir():
            if file.name != "00.png":
                file.unlink()
        cv2.imwrite(str(frames / "00.png"), np.zeros((64, 64, 3), dtype=np.uint8))
        assert main(["bundle", "check", str(small), "--against", str(big), "--frames", str(frames)]) == 0
        assert "a word without masks cannot be compared" in capsys.readouterr().out


def test_both_kinds_are_compared_and_other_weights_are_told(
    tmp_path: Path, frames: Path, capsys: Out
) -> None:
    pytest.importorskip("onnx", reason="exports need onnx")
    pytest.importorskip("onnxruntime", reason="bundles need ONNX Runtime")
    from anytraverse.export.making import make_bundle
    from anytraverse.export.random_weights import TINY, random_clipseg

    for name, size, seed in (("small", 64, 0), ("big", 96, 0), ("other", 96, 1)):
        make_bundle(tmp_path / name, random_clipseg(TINY, seed), size=size, name="tiny")
    command = ["bundle", "check", str(tmp_path / "small"), "--frames", str(frames), "--words", "grass,rock"]
    assert main([*command, "--against", str(tmp_path / "big"), "--threads", "1", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["same_weights"] is True
    assert set(found["words"]) == {"grass", "rock"}
    assert found["milliseconds"] > 0
    assert main([*command, "--against", str(tmp_path / "other"), "--threads", "1"]) == 0
    assert "NOTE: the weights differ" in capsys.readouterr().out


def test_a_dense_bundle_that_is_not_calibrated_is_refused(tmp_path: Path, frames: Path, capsys: Out) -> None:
    pytest.importorskip("onnx", reason="exports need onnx")
    pytest.importorskip("onnxruntime", reason="bundles need ONNX Runtime")
    from anytraverse.export.dense_making import make_dense_bundle
    from anytraverse.export.random_weights import TINY_DENSE, random_dense

    for name, size in (("small", 64), ("big", 96)):
        make_dense_bundle(tmp_path / name, random_dense("siglip", TINY_DENSE["siglip"], 64), size=size)
    command = ["bundle", "check", str(tmp_path / "small"), "--against", str(tmp_path / "big")]
    assert main([*command, "--frames", str(frames)]) == 2
    assert "is not calibrated" in capsys.readouterr().err
