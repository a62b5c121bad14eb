"""The daemon on bundles of tiny models: what it says of the variant, and of weights that are broken."""

from __future__ import annotations

import json
import socket
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from anytraverse.bundle.calibrating import calibrate
from anytraverse.bundle.records import CheckRuntime
from anytraverse.errors import AnyTraverseError
from anytraverse.export.dense_making import make_dense_bundle
from anytraverse.export.making import make_bundle
from anytraverse.export.random_weights import TINY, TINY_DENSE, random_clipseg, random_dense
from anytraverse.perception.dense.perceiver import Dense
from companion import run
from companion.cli import main
from companion.config import load_config
from companion.wire import notices
from tests.anytraverse.clipseg.pictures import picture
from tests.companion.processes import heard, painted_config

PATIENCE = 10.0


class Site:
    """A folder with pictures and a configuration, and a radio that only listens."""

    def __init__(self, folder: Path, radio: socket.socket) -> None:
        self.folder, self.radio = folder, radio
        random = np.random.default_rng(0)
        self.pictures = [random.integers(0, 256, (48, 64, 3), dtype=np.uint8) for _ in range(3)]

    def bundle(self, precisions: Sequence[str] = ("fp32",), broken: str = "") -> None:
        """Make the bundle, perhaps with a weight that overflows."""
        checkpoint = random_clipseg(TINY)
        if broken:
            checkpoint.weights[broken][...] = 3e38
        make_bundle(self.folder / "tiny", checkpoint, size=64, precisions=precisions, name="tiny")

    def dense(self) -> None:
        """Make a bundle of a tiny SigLIP 2, not calibrated."""
        checkpoint = random_dense("siglip", TINY_DENSE["siglip"], 64)
        make_dense_bundle(self.folder / "tiny", checkpoint, name="tiny")

    def configure(self, perceiver: str = "", kind: str = "clipseg") -> Path:
        """The file, with the bundle beside it."""
        hold = 'rock = -1.0\n[call]\npolicy = "hold"\n[stopping]\nunchecked = true'
        lines = {"perceiver": f'name = "{kind}:tiny"\nthreads = 1\n{perceiver}', "more": hold}
        return painted_config(self.folder, self.radio.getsockname()[1], self.pictures, **lines)

    def run(self, fits: Callable[[dict[str, Any]], bool]) -> list[dict[str, Any]]:
        """Run the daemon until its status fits; all that it wrote."""
        path, seen = self.folder / "state" / "status.json", list[dict[str, Any]]()
        deadline = time.monotonic() + PATIENCE

        def stop() -> bool:
            if path.is_file():
                seen.append(json.loads(path.read_text()))
            return (bool(seen) and fits(seen[-1])) or time.monotonic() > deadline

        assert run.main(load_config(self.folder / "companion.toml"), stop) == 0
        assert fits(seen[-1]), seen[-1]
        return seen


@pytest.fixture
def site(tmp_path: Path, radio: socket.socket) -> Site:
    return Site(tmp_path, radio)


def judged(status: dict[str, Any]) -> bool:
    """Some frames were."""
    return bool(status["frames"] >= 6)


def test_what_runs_and_why_stands_in_the_status_with_the_time_that_it_takes(
    site: Site, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level("INFO")
    site.bundle()
    site.configure("scene_every = 5")
    statuses = site.run(judged)
    told = statuses[-1]["perceiver"]
    assert told["model"].startswith("tiny-64-shared-")
    assert told["precision"] == "fp32"
    assert "carries no int8 variant" in told["why"]
    assert told["step_ms"] > 0
    assert f"perceiver: {told['model']}, fp32: the bundle carries no int8 variant" in caplog.text
    assert notices.int8_idle().encode() not in heard(site.radio)


def test_an_int8_that_is_not_used_is_told_once(site: Site, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level("INFO")
    site.bundle(("fp32", "int8"))
    site.configure()
    statuses = site.run(judged)
    assert statuses[-1]["perceiver"]["precision"] == "fp32"
    assert heard(site.radio).count(notices.int8_idle().encode()) == 1
    assert "anytraverse bundle check" in caplog.text, "the log says how to get it"


def test_nothing_is_told_of_int8_to_who_asked_for_fp32(site: Site) -> None:
    site.bundle(("fp32", "int8"))
    site.configure('precision = "fp32"')
    site.run(judged)
    assert notices.int8_idle().encode() not in heard(site.radio)


def test_an_int8_that_was_never_checked_cannot_be_demanded(site: Site) -> None:
    site.bundle(("fp32", "int8"))
    site.configure('precision = "int8"')
    with pytest.raises(AnyTraverseError, match=r"int8 must not run here: .*not checked on this machine"):
        site.run(judged)


@pytest.mark.parametrize("broken", ["decoder.layers.0.layer_norm1.weight", "clip.visual_projection.weight"])
def test_weights_that_overflow_end_in_a_fault_that_is_told(site: Site, broken: str) -> None:
    site.bundle(broken=broken)
    site.configure()
    statuses = site.run(lambda status: judged(status) and status["state"] == "fault")
    assert "ok" not in {status["state"] for status in statuses}
    assert {status["policy"] for status in statuses} == {"hold"}, "it may hold the rover for it"
    assert b"Companion FAULT" in heard(site.radio)


def test_a_check_of_the_configuration_says_what_would_run_and_why(
    site: Site, capsys: pytest.CaptureFixture[str]
) -> None:
    site.bundle(("fp32", "int8"))
    path = site.configure()
    assert main(["config", "check", str(path)]) == 0
    told = capsys.readouterr()
    assert told.out.startswith("# perceiver: tiny-64-shared-")
    assert "fp32: int8 stays off: not checked on this machine" in told.out.splitlines()[0]
    assert f"loading clipseg:{site.folder}/tiny" in told.err
    (site.folder / "again.toml").write_text(told.out)
    assert load_config(site.folder / "again.toml").perceiver == load_config(path).perceiver


def test_a_check_of_the_configuration_finds_a_torn_bundle(
    site: Site, capsys: pytest.CaptureFixture[str]
) -> None:
    site.bundle()
    (site.folder / "tiny" / "tail.onnx").write_bytes(b"torn")
    assert main(["config", "check", str(site.configure())]) == 2
    assert "tail.onnx" in capsys.readouterr().err


def test_a_bundle_that_is_not_there_is_told_with_its_place(
    site: Site, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["run", str(site.configure())]) == 2
    assert f"{site.folder}/tiny is not a bundle" in capsys.readouterr().err


def test_a_dense_bundle_runs_once_it_is_calibrated(site: Site, capsys: pytest.CaptureFixture[str]) -> None:
    site.dense()
    path, folder = site.configure(kind="dense"), site.folder / "tiny"
    assert main(["config", "check", str(path)]) == 2
    assert "is not calibrated" in capsys.readouterr().err
    frames = [picture(96, 72, seed) for seed in range(24)]
    calibrate(folder, Dense(str(folder), CheckRuntime(threads=1, precision="fp32")), frames, ["grass"], print)
    told = site.run(judged)[-1]["perceiver"]
    assert told["model"].startswith("tiny-64-")
    assert told["precision"] == "fp32"
