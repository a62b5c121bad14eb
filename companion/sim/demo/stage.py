"""Sets the demo's stage: the simulated field, the daemon and the operator as processes."""

from __future__ import annotations

import contextlib
import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple

from companion.sim.demo.child import LoggedProcess
from companion.sim.demo.config import write_config
from companion.sim.demo.operator import start_operator
from companion.sim.demo.pace import PACES, DemoPace
from companion.sim.field.control import FieldControl

ACROSS = 31.0
"""m from the start, in the meadow: where a log lies across the path in the demo of guiding."""
STARTS_WITHIN = 300.0
"""Seconds: a busy computer loads the field's program that long."""


class DemoSetup(NamedTuple):
    """What the daemon's configuration is written with, beside the pace.

    camera, link: as in the configuration. guide: the path is wide, and the policy is guide. console: the
    operator has a browser, and the link is a network's. record: every frame is recorded.
    """

    camera: str
    link: str
    guide: bool
    console: bool
    record: bool


@dataclass
class DemoStage:
    """Holds the demo's processes and the folder `out` that they write to."""

    out: Path
    trail: LoggedProcess
    daemon: LoggedProcess
    operator: LoggedProcess
    control: FieldControl
    setup: DemoSetup
    pace: DemoPace = PACES[0]

    @property
    def speed(self) -> float:
        """m/s that the rover drives."""
        return self.pace.drives(guide=self.setup.guide)

    def daemon_status(self) -> dict[str, Any]:
        """Reads the daemon's status file; empty while there is none."""
        with contextlib.suppress(OSError, ValueError):
            status = json.loads(self._status_file.read_text(encoding="utf-8"))
            return status if isinstance(status, dict) else {}
        return {}

    def change_pace(self, pace: DemoPace) -> None:
        """Starts the daemon again, to judge at this pace, and has the rover drive by it.

        What it knew it reads from its journal. Raises FieldError.
        """
        self.daemon.stop()
        self._status_file.unlink(missing_ok=True)
        self.pace = pace
        self.control.film(pace.drawn)
        self.control.parameter("WP_SPEED", self.speed)
        self.control.parameter("ATS_TIMEOUT", pace.silence)
        self.daemon = _daemon(self.out, self.setup, pace)

    def close(self) -> None:
        """Ends all processes, the operator first."""
        for child in (self.operator, self.daemon):
            child.stop()
        with contextlib.suppress(Exception):
            self.control.stop()
            self.control.close()
        self.trail.stop()

    @property
    def _status_file(self) -> Path:
        return self.out / "state" / "status.json"


def set_stage(
    out: Path,
    seed: int,
    *,
    auto: bool,
    speed: float | None = None,
    console: bool = False,
    guide: bool = False,
    record: bool = False,
    pace: DemoPace = PACES[0],
) -> DemoStage:
    """Starts field, daemon and operator. Raises ChildError.

    speed: m/s that the rover drives, None: by the pace. The rest is as of `DemoSetup`.
    """
    if speed is not None:
        pace = pace._replace(speed=speed, guided=speed)
    logs = out / "logs"
    logs.mkdir(exist_ok=True)
    started: list[LoggedProcess] = []

    def track(child: LoggedProcess) -> LoggedProcess:
        started.append(child)
        return child

    drives, wide = pace.drives(guide=guide), ["--half-width", "2.4", "--across", str(ACROSS)] if guide else []
    arguments = ["companion.sim.field", "--seed", str(seed), "--speed", str(drives), *wide]
    try:
        field = track(LoggedProcess("field", arguments, logs / "field.log"))
        ports = json.loads(field.first_line(STARTS_WITHIN))
        if ports["script"] != "running":
            print(f"The script that stops the rover when the daemon is dead is {ports['script']}")
        setup = DemoSetup(f"field:{ports['frames']}", ports["companion"], guide, console, record)
        daemon = track(_daemon(out, setup, pace))
        operator = track(start_operator(ports["gcs"], logs, auto=auto, console=console))
        host, _, port = ports["control"].rpartition(":")
        return DemoStage(out, field, daemon, operator, FieldControl(host, int(port)), setup, pace)
    except BaseException:
        for child in reversed(started):
            child.stop()
        raise


def _daemon(out: Path, setup: DemoSetup, pace: DemoPace) -> LoggedProcess:
    config = write_config(
        out,
        camera=setup.camera,
        link=setup.link,
        policy="guide" if setup.guide else "hold",
        speed=pace.drives(guide=setup.guide),
        network=setup.console,
        rate=pace.rate,
        freshness=pace.freshness,
        guide=setup.guide,
        record=setup.record,
    )
    return LoggedProcess("daemon", ["companion", "run", str(config)], out / "logs" / "daemon.log")
