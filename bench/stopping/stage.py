"""One rover on the trail with its companion: processes, what they say, and how a stop is measured."""

from __future__ import annotations

import contextlib
import json
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from bench.stopping.limits import Limit, braking, script_timeout
from companion.config import load_config
from companion.demo.child import Child
from companion.demo.config import write_config
from companion.field.control import FieldControl
from companion.field.rover import STANDSTILL

READY_WITHIN = 60.0
DRIVING_WITHIN = 40.0
BEYOND = 6.0
"""Seconds beyond the limit after which a rover counts as not stopped."""
LOOK = 0.02
_QUIET = """\

[thresholds]
roi = 1.0
tile = "off"
scene = -1.0
trav = 0.0

[words]
"grass" = 1.0
"dry grass" = 1.0
"dirt path" = 1.0
"gravel" = 1.0
"""


class Disturbed(Exception):  # noqa: N818
    """The run says nothing: the rover was not driving when it should have been. The message says why."""


@dataclass(frozen=True)
class Plan:
    """How a stage is set. at: m along the trail. speed: m/s at most.

    quiet: no word is missing and no place is new, so that nothing but a fault can stop the rover.
    """

    seed: int
    at: float
    speed: float = 2.5
    policy: str = "hold"
    perceiver: str = "builtin"
    module: str = "companion"
    quiet: bool = True
    surprises: bool = False
    script: bool = True


@dataclass(frozen=True)
class Stop:
    """From a fault to standstill: by the simulation's clock and way. by: who changed the mode, "" nobody.

    limit, seconds: s. metres: m. speed: m/s at the fault.
    """

    stopped: bool
    seconds: float
    metres: float
    limit: float
    speed: float
    zone: str
    by: str


class Stage:
    """Field and companion, started; ends them when left."""

    def __init__(self, out: Path, plan: Plan, cancelled: threading.Event) -> None:
        self.out, self.plan = out, plan
        self._cancelled = cancelled
        self._children: list[Child] = []
        out.mkdir(parents=True, exist_ok=True)
        try:
            self._set()
        except BaseException:
            self.close()
            raise

    def _set(self) -> None:
        plan = self.plan
        asked = ["--seed", str(plan.seed), "--at", f"{plan.at:.1f}", "--speed", f"{plan.speed:.2f}"]
        asked += ["--surprises"] * plan.surprises + ["--no-script"] * (not plan.script)
        field = self._child("field", ["bench.stopping.field", *asked])
        self.ports: dict[str, Any] = json.loads(field.first_line(READY_WITHIN))
        if plan.script and self.ports["script"] != "running":
            raise RuntimeError(f"the script on the autopilot is {self.ports['script']}")
        host, _, port = self.ports["control"].rpartition(":")
        self.control = FieldControl(host, int(port))
        self.config = self._write_config(f"field:{self.ports['frames']}", self.ports["companion"])
        self.freshness = load_config(str(self.config)).freshness
        self.start_daemon()

    def __enter__(self) -> Stage:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End all processes, whatever state they are in."""
        for child in reversed(self._children):
            child.process.kill()
        for child in self._children:
            child.stop()
        if hasattr(self, "control"):
            self.control.close()

    def start_daemon(self) -> None:
        """A companion on the configuration; an earlier one must be dead."""
        (self.out / "state" / "status.json").unlink(missing_ok=True)
        self.daemon = self._child("daemon", [self.plan.module, "run", "--config", str(self.config)])

    def status(self) -> dict[str, Any]:
        """The field's."""
        return self.control.status()

    def told(self) -> dict[str, Any]:
        """The companion's status file; empty while there is none."""
        with contextlib.suppress(OSError, ValueError):
            return dict(json.loads((self.out / "state" / "status.json").read_text(encoding="utf-8")))
        return {}

    def wait(self, what: str, fits: Callable[[], bool], limit: float) -> None:
        """Until `fits`; Disturbed after `limit` s, or when a process has ended."""
        until = time.monotonic() + limit
        while not fits():
            if self._cancelled.is_set():
                raise KeyboardInterrupt
            if time.monotonic() > until:
                raise Disturbed(f"{what}: not within {limit:.0f} s")
            if not self.daemon.running:
                raise self.daemon.error(f"ended: {what}")
            time.sleep(LOOK)

    def wait_until_well(self) -> None:
        """Until the companion sees, and has said so for long enough that autopilot and script know."""
        since = time.time()
        self.wait("a companion that is well", lambda: self._well_after(since), READY_WITHIN)

    def _well_after(self, since: float) -> bool:
        path = self.out / "state" / "status.json"
        with contextlib.suppress(OSError):
            return path.stat().st_mtime > since + 0.5 and self.told().get("state") in ("ok", "holding")
        return False

    def drive(self, longer: float = 0.0) -> None:
        """Arm, AUTO by hand, and `longer` s at cruise speed."""
        self.control.start()
        self.wait("driving", self._is_driving, DRIVING_WITHIN)
        until = time.monotonic() + longer
        self.wait("driving on", lambda: time.monotonic() >= until, longer + 1.0)
        status = self.status()
        if status["mode"] != "AUTO":
            raise Disturbed(f"it stood already: {status['mode_log'][-1]}")

    def _is_driving(self) -> bool:
        status = self.status()
        if status["mode"] != "AUTO":
            raise Disturbed(f"it was held: {status['mode_log'][-1]}")
        return bool(status["speed"] > 0.95 * self.plan.speed)

    def measure(self, fault: Callable[[], None]) -> Stop:
        """What comes of a fault that begins now."""
        before = self.status()
        fault()
        limit = Limit(self.freshness, script_timeout(), braking(before["speed"])[0]).seconds
        after = self.status()
        while after["speed"] > STANDSTILL and after["t"] - before["t"] < limit + BEYOND:
            if self._cancelled.is_set():
                raise KeyboardInterrupt
            time.sleep(LOOK)
            after = self.status()
        seconds = after["t"] - before["t"]
        held = [change for change in after["mode_log"] if change["t"] >= before["t"]]
        return Stop(
            stopped=after["speed"] <= STANDSTILL and after["mode"] == "HOLD" and seconds <= limit,
            seconds=seconds,
            metres=after["distance"] - before["distance"],
            limit=limit,
            speed=before["speed"],
            zone=before["zone"],
            by=held[0]["by"] if held else "",
        )

    def _child(self, name: str, arguments: list[str]) -> Child:
        child = Child(name, arguments, self.out / f"{name}.log")
        self._children.append(child)
        return child

    def _write_config(self, camera: str, link: str) -> Path:
        plan = self.plan
        path = write_config(self.out, camera=camera, link=link, policy=plan.policy, speed=plan.speed)
        text = path.read_text(encoding="utf-8")
        if plan.quiet:
            text = text.partition("[words]")[0].replace("top = 0.46", "top = 0.44") + _QUIET
        text += f'\n[perceiver]\nname = "{plan.perceiver}"\nthreads = 1\n'
        path.write_text(text, encoding="utf-8")
        return path
