"""`anytraverse export` without a checkpoint, and a first look through what it made: no torch is needed."""

from __future__ import annotations

import functools
import json
import re
import subprocess
import sys
from pathlib import Path

import cv2
import pytest

from anytraverse.cli import main
from anytraverse.export import random_weights
from anytraverse.release import to_install
from tests.anytraverse.clipseg.pictures import picture

Out = pytest.CaptureFixture[str]


@pytest.fixture
def small(monkeypatch: pytest.MonkeyPatch) -> None:
    """Random weights of a small CLIPSeg in place of the published one."""
    made = functools.partial(random_weights.random_clipseg, random_weights.TINY)
    monkeypatch.setattr(random_weights, "random_clipseg", made)


@pytest.mark.usefixtures("small")
def test_random_weights_are_exported_looked_through_and_checked(tmp_path: Path, capsys: Out) -> None:
    out, photo = tmp_path / "deep/bundle", tmp_path / "photo.png"
    assert main(["export", "random", str(out), "--size", "64", "--precision", "int8, fp32"]) == 0
    told = capsys.readouterr()
    assert re.fullmatch(
        rf"{out}: random-64-shared-[0-9a-f]{{8}}, fp32, int8, \d+ MB", told.out.splitlines()[0]
    )
    assert "licence: none needed" in told.out
    assert "anytraverse bundle check bundle" in told.out
    cv2.imwrite(str(photo), picture(320, 240, 1)[..., ::-1])
    assert (
        main(
            ["look", str(photo), "--perceiver", f"clipseg:{out}", "--prompts", "grass: 1; rock: -1", "--json"]
        )
        == 0
    )
    figures = json.loads(capsys.readouterr().out.splitlines()[-1])
    assert figures["prompts"] == {"grass": 1.0, "rock": -1.0}
    assert 0 < figures["roi_uncertainty"] < 1
    assert main(["bundle", "check", str(out), "--threads", "1", "--repeat", "1"]) == 0


@pytest.mark.usefixtures("small")
def test_every_step_is_told_as_it_begins_with_the_seconds_so_far(tmp_path: Path, capsys: Out) -> None:
    assert main(["export", "random", str(tmp_path / "bundle"), "--size", "64"]) == 0
    lines = capsys.readouterr().err.splitlines()
    assert all(re.match(r" *\d+\.\d s  \S", line) for line in lines)
    steps = [line.split("s  ", 1)[1] for line in lines]
    assert steps[0].startswith("drawing random weights")
    writing = [step for step in steps if step.startswith("writing ")]
    assert writing[:4] == [
        "writing image, fp32",
        "writing tail, fp32",
        "writing decoder, fp32",
        "writing text-1, fp32",
    ]
    assert any(step.startswith("image.weights  ") and step.endswith(" MB") for step in steps)


@pytest.mark.usefixtures("small")
def test_it_is_the_same_bundle_every_time_and_replaces_the_one_before(tmp_path: Path) -> None:
    command = ["export", "random", str(tmp_path / "bundle"), "--size", "64", "--name", "mine"]
    manifests = []
    for _ in range(2):
        assert main(command) == 0
        manifests.append((tmp_path / "bundle/manifest.json").read_bytes())
    assert manifests[0] == manifests[1]
    assert [path.name for path in tmp_path.iterdir()] == ["bundle"]


@pytest.mark.usefixtures("small")
@pytest.mark.parametrize(
    ("options", "reason"),
    [
        (["--size", "60"], "size 60 does not fit: give a multiple of 16"),
        (["--precision", "fp16"], 'no precision is called "fp16": choose from fp32, int8'),
    ],
)
def test_a_refusal_is_one_line_and_code_2(
    tmp_path: Path, capsys: Out, options: list[str], reason: str
) -> None:
    assert main(["export", "random", str(tmp_path / "bundle"), *options]) == 2
    last = capsys.readouterr().err.splitlines()[-1]
    assert last.startswith(f"anytraverse export: {reason}")
    assert list(tmp_path.iterdir()) == []


def test_a_place_that_is_taken_is_refused_at_once(tmp_path: Path, capsys: Out) -> None:
    (tmp_path / "notes.txt").write_text("mine")
    for place, reason in ((tmp_path, "exists and is not a bundle"), (tmp_path / "notes.txt", "is a file")):
        assert main(["export", "random", str(place)]) == 2
        (line,) = capsys.readouterr().err.splitlines()
        assert reason in line


@pytest.mark.parametrize(("checkpoint", "missing"), [("random", "onnx"), ("somebody/clipseg", "torch")])
def test_what_is_not_installed_is_named(tmp_path: Path, checkpoint: str, missing: str) -> None:
    script = (
        f"import sys; sys.modules[{missing!r}] = None; from anytraverse.cli import main; sys.exit(main())"
    )
    command = [sys.executable, "-c", script, "export", checkpoint, str(tmp_path / "bundle")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 2
    (line,) = done.stderr.splitlines()
    assert f"needs {missing}: on a workstation, {to_install('export')}" in line


def test_an_encoder_that_would_not_be_used_is_refused(tmp_path: Path, capsys: Out) -> None:
    assert main(["export", "random", str(tmp_path / "out"), "--clip", "somewhere"]) == 2
    assert "--scene clip-b32" in capsys.readouterr().err
