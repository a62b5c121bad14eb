"""Runs `companion demo --camera ...`: judges real frames and prints where it would have held."""

from __future__ import annotations

import contextlib
import json
import socket
import time
from pathlib import Path
from typing import Any

from companion.cameras.shown import shown
from companion.sim.demo.child import ChildError, LoggedProcess
from companion.sim.demo.config import write_config
from companion.sim.demo.operator import start_operator
from companion.sim.demo.sheet import write_sheet
from companion.sim.demo.story import Story

LIMIT = 1800.0
THINK = 1.5
STEP = 0.1


def run_camera_demo(camera: str, out: Path, story: Story, *, auto: bool) -> int:
    """Plays the camera to its end in shadow policy. Returns 0 when frames were judged, else 1."""
    logs = out / "logs"
    logs.mkdir(exist_ok=True)
    port = free_port()
    story.plain(
        f"No rover: {shown(camera)} is judged as if one drove by it. `shadow` says where it would have held."
    )
    operator = start_operator(f"udpin:127.0.0.1:{port}", logs, auto=auto)
    try:
        config = write_config(out, camera=camera, link=f"udpout:127.0.0.1:{port}", policy="shadow")
        daemon = LoggedProcess("daemon", ["companion", "run", str(config)], logs / "daemon.log")
        try:
            figures = _Rehearsal(daemon, operator, out, story, auto=auto).follow()
        finally:
            daemon.stop()
    finally:
        operator.stop()
    sheet = write_sheet(out)
    if sheet is not None:
        story.plain(f"Contact sheet of the key frames: {sheet}")
    if auto:
        story.plain(json.dumps({**figures, "contact_sheet": str(sheet or "")}))
    else:
        story.plain(f"{figures['frames']} frames, {figures['calls']} calls, {figures['would_hold']} holds.")
    return 0 if figures["frames"] else 1


class _Rehearsal:
    """Follows daemon and operator; with `auto` it answers every call with go."""

    def __init__(
        self, daemon: LoggedProcess, operator: LoggedProcess, out: Path, story: Story, *, auto: bool
    ) -> None:
        self._daemon = daemon
        self._operator = operator
        self._out = out
        self._status_file = out / "state" / "status.json"
        self._story = story
        self._auto = auto
        self._status: dict[str, Any] = {}
        self._asked_at: dict[int, float] = {}
        self._calls = 0
        self._started = time.monotonic()

    def follow(self) -> dict[str, Any]:
        """Runs until the camera has ended, the operator quits or Ctrl-C; returns the figures.

        Raises ChildError when a process ends early or no frame comes.
        """
        with contextlib.suppress(KeyboardInterrupt):
            self._follow()
        return {
            "frames": self._status.get("frames", 0),
            "calls": self._calls,
            "would_hold": self._status.get("shadow", {}).get("would_hold", 0),
            "seconds": round(self._seconds, 1),
        }

    def _follow(self) -> None:
        while self._seconds < LIMIT and (self._auto or self._operator.running):
            time.sleep(STEP)
            for child in (self._daemon, *([self._operator] if self._auto else [])):
                if not child.running:
                    raise child.error("ended")
            self._read_status()
            for _, line in self._operator.lines():
                with contextlib.suppress(ValueError):
                    self._handle_event(json.loads(line))
            if self._auto:
                self._answer()
            if self._over():
                self._story.log(self._seconds, "the drive is over")
                break

    @property
    def _seconds(self) -> float:
        return time.monotonic() - self._started

    def _read_status(self) -> None:
        with contextlib.suppress(OSError, ValueError):
            self._status = json.loads(self._status_file.read_text(encoding="utf-8"))
        self._story.where = f"frame {self._status.get('frames', 0)}"

    def _handle_event(self, event: dict[str, Any]) -> None:
        if self._auto:
            self._story.event(event, self._seconds)
        else:  # the operator's own terminal prints the rest
            self._story.picture(event, self._out, self._seconds)
        name = event.get("event")
        if name == "call":
            self._asked_at[event["id"]] = time.monotonic()
            self._calls += 1
        elif name == "closed":
            self._asked_at.pop(event["id"], None)
        elif name == "text" and " would hold: " in event["text"] and self._auto:
            self._story.log(self._seconds, event["text"])

    def _answer(self) -> None:
        now = time.monotonic()
        for call, since in self._asked_at.items():
            if now - since > THINK:
                self._asked_at[call] = now
                self._story.log(self._seconds, f"operator types: {call} go")
                self._operator.type(f"{call} go")

    def _over(self) -> bool:
        camera = self._status.get("camera", {})
        if camera.get("state") == "failed" and not camera.get("read"):
            raise ChildError(f"no frame came: {camera.get('reason')}; see {self._daemon.log}")
        return bool(camera.get("state") == "ended")


def free_port() -> int:
    """Returns a UDP port of 127.0.0.1 that is not in use now."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port
