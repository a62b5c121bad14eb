"""A CLIPSeg of the true size and random weights drives the simulated trail for a while.

Its maps mean nothing; that the daemon keeps its rate, its memory, its calls and the freshness limit does. The
limits follow from what `anytraverse bundle check` says of this machine, as an owner would set them; how fast
that is, `make bench-clipseg` measures. ANYTRAVERSE_FIELD_SECONDS drives for longer, or shorter.
"""

from __future__ import annotations

import contextlib
import itertools
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import closing
from functools import partial
from pathlib import Path
from typing import Any

import pytest

from anytraverse.pace import Pace
from bench.processes import children
from companion.desk.check.here import read_status
from companion.sim.demo.child import LoggedProcess
from companion.sim.demo.operator import start_operator
from companion.sim.field.control import FieldControl
from companion.vision.worker import STORED_FRAMES
from tests.waiting import wait_for

SECONDS = float(os.environ.get("ANYTRAVERSE_FIELD_SECONDS", "14"))
RATE = 2.0
SLACK = 6.0
"""A machine that also runs the field and other tests takes several times as long as in a check."""
SHORTEST_FRESHNESS, LONGEST_FRESHNESS = 2.0, 10.0
READY_WITHIN = 120.0
PEAK_MB = 900.0
FRAME_MB = 8.4
"""What a judged frame keeps with four words, for answers to its call: `python -m bench.growth words`."""
ALLOCATOR_MB = 16.0
"""What the allocator keeps of one frame's work, and gives back and takes again from frame to frame."""
GROWTH_MB = STORED_FRAMES * FRAME_MB + ALLOCATOR_MB
"""In half a drive: of how many calls frames are stored in it depends on how late a busy machine calls."""

CLI = [sys.executable, "-m", "anytraverse.cli"]
CONFIG = """
[camera]
source = "field:{frames}"
rate = {rate}
[perceiver]
name = "clipseg:bundle"
[web]
listen = ""
[recording]
size = 0
[vehicle]
file = ""
[link]
url = "{companion}"
[journal]
folder = "{folder}/state"
[stopping]
unchecked = true
[call]
policy = "report"
freshness = {freshness}
[words]
grass = 1.0
"dirt path" = 1.0
bush = -1.0
"""


class Drive:
    """Field, daemon and operator, and what they said. Times are monotonic seconds."""

    def __init__(self, folder: Path, step: float) -> None:
        """step: seconds that a frame takes on this machine."""
        self.folder = folder
        self.rate = max(0.5, min(RATE, 1.0 / step))
        needed = SLACK * Pace(step, 1.0 / self.rate, 0.0).worst_age
        self.freshness = round(min(LONGEST_FRESHNESS, max(SHORTEST_FRESHNESS, needed)), 2)
        self.events: list[tuple[float, dict[str, Any]]] = []
        self.memory: list[tuple[float, float, float]] = []
        """Seconds, MB that daemon and vision take, MB of it that are not of files, which others map, too."""
        size = ["--width", "640", "--height", "480"]
        self.field = LoggedProcess(
            "field", ["companion.sim.field", "--fps", "6", *size], folder / "field.log"
        )
        ports = json.loads(self.field.first_line(20.0))
        path = folder / "companion.toml"
        limits = {"rate": self.rate, "freshness": self.freshness}
        path.write_text(CONFIG.format(**ports, folder=folder, **limits))
        self.operator = start_operator(ports["gcs"], folder, auto=True)
        self.daemon = LoggedProcess("daemon", ["companion", "run", str(path)], folder / "daemon.log")
        host, _, port = ports["control"].rpartition(":")
        self.control = FieldControl(host, int(port))

    def status(self) -> dict[str, Any]:
        """What the daemon last wrote; empty before it is ready."""
        return read_status(self.folder / "state")[1]

    def look(self) -> None:
        """Take in what happened in half a second."""
        time.sleep(0.5)
        assert self.daemon.running, self.daemon.error("died")
        self.events += [(at, json.loads(line)) for at, line in self.operator.lines()]
        family = [self.daemon.process.pid, *children(self.daemon.process.pid)]
        taken, owned = (sum(_kilobytes(pid, kind) for pid in family) / 1e3 for kind in ("Pss", "Anonymous"))
        self.memory.append((time.monotonic(), taken, owned))

    def wait_until_it_sees(self) -> None:
        """Loaded, warmed up, and the first frame judged."""
        never = partial(self.daemon.error, "was never ready")
        wait_for(lambda: self.status().get("frames"), READY_WITHIN, never, self.look)

    def told(self, *kinds: str) -> list[dict[str, Any]]:
        """The events of these kinds, in order."""
        return [event for _, event in self.events if event["event"] in kinds]

    def close(self) -> None:
        """End what still runs."""
        for child in (self.operator, self.daemon):
            child.stop()
        with contextlib.suppress(Exception):
            self.control.stop()
            self.control.close()
        self.field.stop()


def _kilobytes(pid: int, kind: str) -> int:
    """Kilobytes of a process. kind: Pss counts what it shares in shares. 0 once it is gone."""
    with contextlib.suppress(OSError, StopIteration):
        lines = Path(f"/proc/{pid}/smaps_rollup").read_text(encoding="ascii").splitlines()
        return next(int(line.split()[1]) for line in lines if line.startswith(f"{kind}:"))
    return 0


@pytest.fixture(scope="module")
def bundle(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Path]:
    """Made in a process of its own, and half a gigabyte that nobody looks at later."""
    made = tmp_path_factory.mktemp("clipseg") / "bundle"
    subprocess.run([*CLI, "export", "random", str(made)], check=True, timeout=300, capture_output=True)
    yield made
    shutil.rmtree(made)


@pytest.fixture
def folder(tmp_path: Path, bundle: Path) -> Path:
    """With the bundle in it."""
    (tmp_path / "bundle").symlink_to(bundle)
    return tmp_path


@pytest.fixture
def drive(folder: Path) -> Iterator[Drive]:
    """Started, and not yet ready."""
    check = [
        *CLI,
        "bundle",
        "check",
        str(folder / "bundle"),
        "--precision",
        "fp32",
        "--repeat",
        "3",
        "--json",
    ]
    checked = subprocess.run(check, check=True, timeout=300, capture_output=True, text=True)
    found = json.loads(checked.stdout.splitlines()[-1])
    with closing(Drive(folder, found["milliseconds"]["fp32"]["slowest"] / 1e3)) as drive:
        yield drive


def test_a_drive_on_the_field_with_clipseg(drive: Drive) -> None:
    drive.wait_until_it_sees()
    ready = drive.status()
    assert ready["hold_refused"] == "", "T suits this machine"
    assert ready["perceiver"]["precision"] == "fp32"
    drive.control.start()
    began = time.monotonic()
    answered = 0
    while time.monotonic() - began < SECONDS:
        drive.look()
        opened = drive.told("call")
        if opened and not answered:
            answered = opened[0]["id"]
            for _ in range(2):  # it is asked about while the rover's words are not read yet
                drive.operator.type(f"{answered} gravel: 1, go")
            drive.operator.type(f"{answered} go")
    status = drive.status()
    drive.daemon.process.terminate()
    assert drive.daemon.process.wait(10.0) == 0, drive.daemon.error("ended badly")

    frames = [row for row in drive.status()["recent"] if row[2] > began]
    ages = [judged - taken for _, taken, judged in frames]
    gaps = [later[2] - sooner[2] for sooner, later in itertools.pairwise(frames)]
    half = [owned for at, _, owned in drive.memory if at > began + SECONDS / 2]
    peak = max(taken for _, taken, _ in drive.memory)
    step, growth = status["perceiver"]["step_ms"], max(half) - half[0]
    print(
        f"\nT {drive.freshness:g} s, {drive.rate:.2g} frames/s aimed at: "
        f"{len(frames)} frames in {SECONDS:.0f} s, the oldest {max(ages):.2f} s old when judged, "
        f"the longest gap {max(gaps):.2f} s, the last step {step:.0f} ms; "
        f"{peak:.0f} MB at most, {growth:+.1f} MB in the second half; {len(drive.told('call'))} calls"
    )
    assert max(ages) <= drive.freshness
    assert max(gaps) <= drive.freshness
    assert len(frames) >= 2 * SECONDS / drive.freshness, "two within T, as a vote needs"
    assert "fault" not in [event["state"] for event in drive.told("state")]
    assert peak <= PEAK_MB
    assert growth <= GROWTH_MB
    _calls_followed_the_rules(drive, answered)


def _calls_followed_the_rules(drive: Drive, answered: int) -> None:
    """One at a time, with rising ids, the answered one closed by its answer, and life goes on after it."""
    assert answered, "random maps call at once"
    acknowledged = [event["result"] for event in drive.told("ack") if event["target"] == answered]
    assert acknowledged
    assert set(acknowledged) <= {"applied", "not_covered", "stale"}
    assert "gravel: 1" in drive.status()["words"]
    open_id, last = 0, 0
    outcomes = {}
    for event in drive.told("call", "closed"):
        if event["event"] == "call":
            assert open_id == 0
            assert event["id"] > last
            open_id = last = event["id"]
        else:
            assert event["id"] == open_id
            outcomes[open_id] = event["outcome"]
            open_id = 0
    assert outcomes[answered] in {"accepted", "answered"}
    if SECONDS >= 60:
        assert last > answered, "an acceptance has limits, and a random map always calls again"


def test_a_signal_while_the_networks_load_ends_it_cleanly(folder: Path) -> None:
    config = folder / "companion.toml"
    place = {"frames": "127.0.0.1:9", "companion": "udpout:127.0.0.1:9"}
    config.write_text(CONFIG.format(**place, folder=folder, rate=RATE, freshness=SHORTEST_FRESHNESS))
    for wait in (0.0, 0.7):
        daemon = LoggedProcess("daemon", ["companion", "run", str(config)], folder / "daemon.log")
        wait_for(lambda: _catches_sigterm(daemon.process.pid), 20.0)  # noqa: B023
        time.sleep(wait)
        daemon.process.terminate()
        assert daemon.process.wait(10.0) == 0, daemon.error("ended badly")


def _catches_sigterm(pid: int) -> bool:
    status = Path(f"/proc/{pid}/status").read_text()
    caught = next(line for line in status.splitlines() if line.startswith("SigCgt:"))
    return bool(int(caught.split()[1], 16) >> (signal.SIGTERM - 1) & 1)
