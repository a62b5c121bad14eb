"""Weights are compared by small maps nearly as in full; a cluster gives the figures of one process."""

from __future__ import annotations

import csv
import json
import shlex
import shutil
import subprocess
from collections.abc import Callable, Iterator
from concurrent.futures import CancelledError, ThreadPoolExecutor
from itertools import product
from pathlib import Path
from threading import Barrier
from typing import Any

import numpy as np
import pytest

import anytraverse
from anytraverse.cli import main
from anytraverse.errors import AnyTraverseError, PerceiverError
from anytraverse.evaluation import evaluating, seeing
from anytraverse.evaluation.evaluating import WorkShare, judged_share
from anytraverse.evaluation.seeing import maps_identity
from anytraverse.evaluation.spreading import SpreadError, spread
from anytraverse.evaluation.weights import read_weights, small_shape
from anytraverse.perception import make_perceiver
from anytraverse.release import program_identity

MakeDrive = Callable[..., Path]
Out = pytest.CaptureFixture[str]

DIRT, GRASS, BUSH, DRUM = 40, 90, 140, 190
WEIGHTS = "dirt: 0.3,0.6,1; grass: 0.4,0.7,1; bush: -1,-0.2"

pytestmark = pytest.mark.usefixtures("grey")


@pytest.fixture
def drive(make_drive: MakeDrive) -> Path:
    """Eight frames of patches of dirt, grass, bush and a drum."""
    rng = np.random.default_rng(3)
    patches = {}
    for number in range(1, 9):
        ids = rng.integers(0, 4, (3, 4))
        patches[number] = (np.array([DIRT, GRASS, BUSH, DRUM])[ids].tolist(), ids.tolist())
    return make_drive(patches)


@pytest.fixture(autouse=True)
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Keep what was seen out of the home folder."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))


def command(name: str, drive: Path, out: Path, *options: str) -> list[str]:
    known = ["--drivable", "dirt path,grass", "--unknown", "barrel", "--out", str(out)]
    return [name, "--dataset", f"folder:{drive}", "--perceiver", "grey", *known, *options]


def run(capsys: Out, arguments: list[str]) -> dict[str, Any]:
    assert main(arguments) == 0
    figures: dict[str, Any] = json.loads(capsys.readouterr().out.splitlines()[-1])
    return figures


def test_every_choice_of_weights_is_scored_and_the_error_of_small_maps_is_told(
    drive: Path, tmp_path: Path, capsys: Out
) -> None:
    figures = run(capsys, command("sweep", drive, tmp_path / "out", "--weights", WEIGHTS))
    weights = figures["weights"]
    assert (weights["sets"], weights["judged_in_full"]) == (18, 7)
    assert weights["error_max"] < 0.05
    with (tmp_path / "out" / "weights.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert {row["prompts"] for row in rows} == {one.format() for one in read_weights(WEIGHTS)}
    scores = [float(row["iou_mean"]) for row in rows]
    assert scores == sorted(scores, reverse=True)
    assert scores[0] - scores[-1] > 0.2, "the weights tell nothing apart"
    assert figures["rows"][0]["prompts"] == rows[0]["prompts"]


def test_small_maps_are_close_to_a_full_run_for_each_choice(drive: Path, tmp_path: Path, capsys: Out) -> None:
    run(capsys, command("sweep", drive, tmp_path / "out", "--weights", WEIGHTS))
    with (tmp_path / "out" / "weights.csv").open() as file:
        small = {row["prompts"]: float(row["iou_mean"]) for row in csv.DictReader(file)}
    asked = [argument for prompts in small for argument in ("--prompts", prompts)]
    full = run(capsys, command("sweep", drive, tmp_path / "full", *asked))["rows"]
    for row in full:
        assert small[row["prompts"]] == pytest.approx(row["iou_mean"], abs=0.05)


def test_what_another_program_saw_is_perceived_again(
    drive: Path, tmp_path: Path, capsys: Out, monkeypatch: pytest.MonkeyPatch
) -> None:
    folders: list[int] = []
    for program in ("one", "one", "another"):
        monkeypatch.setattr(seeing, "program_identity", lambda program=program: program)
        run(capsys, command("sweep", drive, tmp_path / f"out-{len(folders)}", "--weights", WEIGHTS))
        folders.append(len(list((tmp_path / "cache" / "anytraverse").iterdir())))
    assert folders == [1, 1, 2]


def test_the_identity_of_the_program_is_that_of_its_files(monkeypatch: pytest.MonkeyPatch) -> None:
    before = program_identity()
    program_identity.cache_clear()
    assert program_identity() == before
    changed = next(Path(anytraverse.__file__).parent.glob("pooling.py"))
    read = Path.read_bytes
    monkeypatch.setattr(Path, "read_bytes", lambda path: read(path) + b" " * (path == changed))
    program_identity.cache_clear()
    assert program_identity() != before
    program_identity.cache_clear()


@pytest.mark.parametrize("library", ["numpy", "onnxruntime-gpu", "onnxruntime-openvino", "opencv-python"])
def test_another_version_of_a_library_is_another_program(
    library: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    found = set()
    for number in ("1.0", "2.0"):
        monkeypatch.setattr(
            "importlib.metadata.version", lambda name, number=number: number if name == library else "1"
        )
        program_identity.cache_clear()
        found.add(program_identity())
    program_identity.cache_clear()
    assert len(found) == 2


def test_choices_are_read_as_they_are_written() -> None:
    found = read_weights("grass: 0.2,1; rock: -1,0.5")
    expected = [f"grass: {one}; rock: {other}" for one, other in product(("0.2", "1"), ("-1", "0.5"))]
    assert [one.format() for one in found] == expected


@pytest.mark.parametrize(
    "text", ["grass", "grass: 2", "grass: 1; grass: 0", "a: " + ",".join(["1"] * 10_001)]
)
def test_choices_that_cannot_be_used_are_refused(text: str) -> None:
    with pytest.raises(AnyTraverseError):
        read_weights(text)


def test_nothing_to_compare_is_told(drive: Path, tmp_path: Path, capsys: Out) -> None:
    assert main(command("sweep", drive, tmp_path / "out")) == 2
    assert "--weights" in capsys.readouterr().err


def test_small_maps_keep_their_proportions() -> None:
    assert small_shape(12, 16) == small_shape(480, 640) == (48, 64)
    assert small_shape(352, 352) == (64, 64)
    assert small_shape(1000, 2) == (64, 1)


LOCAL: dict[str, Any] = {
    "threads_per_worker": 1,
    "processes": False,
    "dashboard_address": None,
    "host": "127.0.0.1",
}
"""Of a Dask cluster in this process."""


@pytest.fixture
def scheduler() -> Iterator[str]:
    """A Dask cluster in this process, with two workers."""
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(n_workers=2, protocol="tcp://", **LOCAL) as cluster:
        yield cluster.scheduler_address


@pytest.mark.slow
def test_a_cluster_gives_the_figures_of_one_process(
    drive: Path, tmp_path: Path, capsys: Out, scheduler: str
) -> None:
    (drive / "0004.jpg").write_bytes(b"torn")
    prompts = ["--prompts", "dirt: 1; grass: 0.7; bush: -1"]
    for name in ("evaluate", "sweep"):
        alone = run(capsys, command(name, drive, tmp_path / f"{name}-alone", *prompts))
        spread = run(capsys, command(name, drive, tmp_path / name, *prompts, "--dask", scheduler))
        alone.pop("ms_per_frame", None)
        spread.pop("ms_per_frame", None)
        assert spread == alone
        assert (spread["images"], spread["torn"]) == (7, 1)
    again = run(capsys, command("evaluate", drive, tmp_path / "evaluate", *prompts))
    assert again["images"] == 7


def test_an_error_of_a_worker_is_told(drive: Path, tmp_path: Path, capsys: Out, scheduler: str) -> None:
    (drive / "0003.png").write_bytes((drive / "0003.jpg").read_bytes())
    prompts = ["--prompts", "dirt: 1", "--dask", scheduler]
    assert main(command("evaluate", drive, tmp_path / "out", *prompts)) == 2
    error = capsys.readouterr().err.splitlines()[-1]
    assert "0003.png" in error


@pytest.mark.parametrize(("threads", "perceivers"), [(1, 1), (2, 2)])
def test_each_thread_of_a_worker_has_one_perceiver(
    drive: Path, monkeypatch: pytest.MonkeyPatch, threads: int, perceivers: int
) -> None:
    made = list[Any]()

    def make(*given: Any) -> Any:
        made.append(make_perceiver(*given))
        return made[-1]

    share = share_of(drive, maps_identity("grey", make_perceiver("grey")))
    monkeypatch.setattr(evaluating, "make_perceiver", make)
    together = Barrier(threads)

    def work(one: WorkShare) -> Any:
        together.wait(10.0)
        return judged_share(one)

    with ThreadPoolExecutor(threads) as pool:
        found = pool.map(work, [share, share])
    assert [number for one in found for number, _ in one] == [2, 2]
    assert len(made) == perceivers


def test_a_worker_with_another_model_is_refused(drive: Path) -> None:
    with pytest.raises(PerceiverError, match="not another-model"):
        judged_share(share_of(drive, "another-model"))


def share_of(drive: Path, model: str) -> WorkShare:
    return WorkShare(f"folder:{drive}", "all", "grey", model, 1, ("dirt: 1",), (2,))


@pytest.mark.slow
@pytest.mark.skipif(shutil.which("openssl") is None, reason="openssl makes the certificate")
def test_a_cluster_with_tls_takes_the_certificates_of_dasks_configuration(tmp_path: Path) -> None:
    distributed, dask = pytest.importorskip("distributed"), pytest.importorskip("dask")
    certificate, key = str(tmp_path / "cert.pem"), str(tmp_path / "key.pem")
    made = (
        f"openssl req -x509 -newkey rsa:2048 -nodes -days 2 -subj /CN=rover -keyout {key} -out {certificate}"
    )
    subprocess.run(shlex.split(made), check=True, capture_output=True)
    parts = {"cert": certificate, "key": key}
    ends = {
        f"tls_{end}_{part}": path for end in ("scheduler", "worker", "client") for part, path in parts.items()
    }
    own = {"ca-file": certificate, "client.cert": certificate, "client.key": key}
    security = distributed.Security(tls_ca_file=certificate, require_encryption=True, **ends)
    with distributed.LocalCluster(n_workers=1, protocol="tls://", security=security, **LOCAL) as cluster:
        address = cluster.scheduler_address
        with pytest.raises(SpreadError, match="needs certificates"):
            spread(abs, [-1], dask=address, done=lambda _number, _result: None)
        with dask.config.set({f"distributed.comm.tls.{name}": path for name, path in own.items()}):
            assert spread(abs, [-1, 2], dask=address, done=lambda _number, _result: None) == [1, 2]


def died(_job: int) -> None:
    raise CancelledError  # as a client finds it whose scheduler went away


def test_a_cluster_that_goes_away_is_told(scheduler: str) -> None:
    with pytest.raises(SpreadError, match="died at their work"):
        spread(died, [1], dask=scheduler, done=lambda _number, _result: None)
