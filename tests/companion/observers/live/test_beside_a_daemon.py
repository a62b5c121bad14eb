"""A whole companion that records nothing is seen by a viewer, also after its live view was killed."""

from __future__ import annotations

import json
import os
import signal
import socket
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("foxglove")
pytest.importorskip("google.protobuf")
pytest.importorskip("websockets")

from bench.processes import children
from tests.companion.daemon.painted_drive import to_a_drum
from tests.companion.observers.live.viewer import Seen, Viewer
from tests.companion.vision.test_processes import ROOT, SCRIPT

PATIENCE = 30.0


def told(state: Path) -> dict[str, Any]:
    with suppress(OSError, ValueError):
        return dict(json.loads((state / "status.json").read_text()))
    return {}


def until(state: Path, live: dict[str, Any]) -> None:
    """Wait for these figures of the live view."""
    deadline = time.monotonic() + PATIENCE
    while not live.items() <= told(state).get("live", {}).items():
        assert time.monotonic() < deadline, told(state)
        time.sleep(0.05)


def live_view(main: int) -> int:
    """The process id of the live view."""
    return next(child for child, command in children(main).items() if "companion.observers.live" in command)


def watched(url: str) -> dict[str, list[Seen]]:
    """What a viewer sees in two seconds, by topic."""
    viewer, found = Viewer(url), dict[str, list[Seen]]()
    for one in viewer.read(2.0):
        found.setdefault(one.topic, []).append(one)
    viewer.close()
    return found


def test_a_viewer_sees_what_a_running_companion_does(tmp_path: Path) -> None:
    with socket.create_server(("127.0.0.1", 0)) as free:
        port = free.getsockname()[1]
    url = f"ws://127.0.0.1:{port}/"
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ground:
        ground.bind(("127.0.0.1", 0))
        config = to_a_drum(tmp_path, ground.getsockname()[1])
        config.write_text(config.read_text() + f'[live]\nlisten = "127.0.0.1:{port}"\n')
        running = subprocess.Popen(
            [sys.executable, "-c", SCRIPT, str(config)],
            cwd=ROOT,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
            stderr=subprocess.DEVNULL,
        )
        try:
            state = tmp_path / "state"
            until(state, {"url": url, "trouble": ""})
            for restarts in (0, 1):
                found = watched(url)
                assert {"/words", "/settings", "/setup", "/state"} <= found.keys(), "what holds, at once"
                assert found["/state"][-1].content["state"] in ("calling", "blocked", "ok")
                shown = {one.at for one in found["/camera"]}
                assert len(shown) >= 3
                assert shown <= {one.at for one in found["/maps/traversability"]} | {max(shown)}
                assert len(found["/assessment"]) > len(shown)
                if not restarts:
                    os.kill(live_view(running.pid), signal.SIGKILL)
                    until(state, {"url": url, "trouble": "", "restarts": 1})
            assert told(state)["recording"]["on"] is False
            assert not (state / "recordings").exists()
        finally:
            running.kill()
            running.wait()
