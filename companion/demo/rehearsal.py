"""`companion demo --camera ...`: real frames, no rover. What the daemon would have done is printed."""

from __future__ import annotations

import contextlib
import json
import socket
import time
from pathlib import Path
from typing import Any

from companion.demo.child import Child, ChildError
from companion.demo.config import write_config
from companion.demo.sheet import write_sheet
from companion.demo.story import Story

LIMIT = 1800.0
THINK = 1.5
STEP = 0.1


def rehearse(camera: str, out: Path, story: Story, *, auto: bool) -> int:
    """Play the camera to its end in shadow policy; 0 when frames were judged."""
    logs = out / "logs"
    logs.mkdir(exist_ok=True)
    port = _free_port()
    operator = Child(
        "operator",
        ["gcs_plugin.terminal", "--connect", f"udpin:127.0.0.1:{port}", *(["--events"] if auto else [])],
        logs / "operator.log",
        interactive=not auto,
    )
    config = write_config(out, camera=camera, link=f"udpout:127.0.0.1:{port}", policy="shadow")
    daemon = Child("daemon", ["companion", "run", "--config", str(config)], logs / "daemon.log")
    story.plain(
        f"No rover: {camera} is judged as if one drove by it. `shadow` says where it would have held."
    )
    try:
        figures = _follow(daemon, operator, out, story, auto=auto)
    finally:
        operator.stop()
        daemon.stop()
    sheet = write_sheet(out)
    if sheet is not None:
        story.plain(f"Contact sheet of the key frames: {sheet}")
    story.plain(json.dumps({**figures, "contact_sheet": str(sheet or "")}))
    return 0 if figures["frames"] else 1


def _follow(daemon: Child, operator: Child, out: Path, story: Story, *, auto: bool) -> dict[str, Any]:
    started = time.monotonic()
    calls: dict[int, float] = {}
    counts = {"calls": 0, "would_hold": 0}
    status: dict[str, Any] = {}
    while time.monotonic() - started < LIMIT and (auto or operator.running):
        time.sleep(STEP)
        with contextlib.suppress(OSError, ValueError):
            status = json.loads((out / "state" / "status.json").read_text(encoding="utf-8"))
        if not daemon.running:
            raise ChildError(f"the daemon ended: see {daemon.log}")
        camera = status.get("camera", {})
        story.where = f"frame {status.get('frames', 0)}"
        for at, line in operator.lines():
            event = json.loads(line)
            story.event(event, at - started)
            if event["event"] == "call":
                calls[event["id"]] = at
                counts["calls"] += 1
            elif event["event"] == "closed":
                calls.pop(event["id"], None)
            elif event["event"] == "text" and "would have held" in event["text"]:
                counts["would_hold"] += 1
                story.tell(at - started, f"the rover would have been held: {event['text']}")
        for call, since in list(calls.items()):
            if time.monotonic() - since > THINK:
                calls[call] = time.monotonic()
                story.tell(time.monotonic() - started, f"operator types: {call} go")
                operator.type(f"{call} go")
        if camera.get("state") == "ended":
            break
        if camera.get("state") == "failed" and not camera.get("read"):
            raise ChildError(f"no frame came: {camera.get('reason')}; see {daemon.log}")
    return {"frames": status.get("frames", 0), **counts, "seconds": round(time.monotonic() - started, 1)}


def _free_port() -> int:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("127.0.0.1", 0))
        port: int = probe.getsockname()[1]
        return port
