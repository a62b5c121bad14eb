"""A whole companion that records nothing is seen by a viewer, also after its live view was killed."""

from __future__ import annotations

import os
import signal
import socket
from contextlib import closing
from pathlib import Path
from typing import Any

import pytest

pytest.importorskip("foxglove")
pytest.importorskip("google.protobuf")
pytest.importorskip("websockets")

from tests.companion.observers.live.viewer import Seen, Viewer
from tests.companion.processes import Companion


def shows(companion: Companion, **live: Any) -> bool:
    """Whether these are figures of the live view."""
    return live.items() <= dict(companion.told().get("live", {})).items()


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
    with closing(Companion(tmp_path, more=f'[live]\nlisten = "127.0.0.1:{port}"')) as companion:
        companion.until(lambda: shows(companion, url=url, trouble=""))
        for restarts in (0, 1):
            found = watched(url)
            assert {"/words", "/settings", "/setup", "/state"} <= found.keys(), "what holds, at once"
            assert found["/state"][-1].content["state"] in ("calling", "blocked", "ok")
            shown = {one.at for one in found["/camera"]}
            assert len(shown) >= 3
            assert shown <= {one.at for one in found["/maps/traversability"]} | {max(shown)}
            assert len(found["/assessment"]) > len(shown)
            if not restarts:
                os.kill(companion.child("companion.observers.live"), signal.SIGKILL)
                companion.until(lambda: shows(companion, url=url, trouble="", restarts=1))
        assert companion.told()["recording"]["on"] is False
        assert not (companion.state / "recordings").exists()
