"""Sets up one rover on the trail with its companion, and measures how it stops."""

from __future__ import annotations

import contextlib
import json
import math
import re
import signal
import threading
import time
from collections.abc import Callable, Mapping
from contextlib import ExitStack, closing
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from bench.stopping import perceivers
from bench.stopping.camera_relay import CameraRelay
from bench.stopping.ground import SecondPort
from bench.stopping.limits import Limit, script_timeout
from bench.stopping.serial_device import SerialDevice
from bench.stopping.slow_disk import SlowDisk
from bench.stopping.stops import Stop, stopped
from bench.stopping.wire import Wire
from companion.config import load_config
from companion.desk.check.here import read_status
from companion.sim.demo.child import LoggedProcess
from companion.sim.demo.config import write_config
from companion.sim.demo.operator import start_operator
from companion.sim.demo.pace import SPEED
from companion.sim.field.control import FieldControl
from companion.sim.field.rover import STANDSTILL
from companion.sim.field.server import AUTOPILOTS
from companion.sim.field.trail import LOOP
from companion.system.atomic_write import write_atomically
from companion.vehicle.course import BACKWARDS, WAY

READY_WITHIN = 60.0
DRIVING_WITHIN = 40.0
RETURN_WITHIN = 15.0
BEYOND = 6.0
"""Seconds beyond the limit after which a rover counts as not stopped."""
STAYS = 0.5
"""Seconds after which a rover that stood is checked again."""
LOOK = 0.02
GUARDED = {"COM_RC_IN_MODE": 1.0, "COM_RC_LOSS_T": 0.5, "COM_FAIL_ACT_T": 0.0, "NAV_RCL_ACT": 1.0}
"""Parameters of a PX4 that holds when the companion's stream of sticks ends."""
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


_OVERSHOOTS = 1.1
"""By which a rover that is guided drives faster than configured. Stopping distances count 1.12."""


class Disturbed(Exception):  # noqa: N818
    """Raised when a run is void: the rover was not driving when it should have been. The message says why."""


@dataclass(frozen=True)
class Plan:
    """How a stage is set up. at: m along the trail. speed: m/s at most.

    quiet: no word is missing and no place is new, so that nothing but a fault can stop the rover.
    breakable: use the perceiver that `Stage.break_perceiver` breaks. listens: the companion listens on a
    port to which others can send. slow_disk: `Stage.disk` can delay what the companion writes. plugged:
    whether the camera is there when the companion starts. autopilot: ardupilot or px4, which has no script.
    mission: m of the trail after which the mission is complete; None: it goes round.
    deadman: the companion streams sticks, the autopilot holds when they end, and no transmitter is on.
    delay: s that the wire takes, each way. serial: the companion's end of it is a serial device.
    brakes: it is held by the script's brake. half: half the path's width in m.
    """

    seed: int
    at: float
    speed: float = SPEED
    policy: str = "hold"
    breakable: bool = False
    quiet: bool = True
    surprises: bool = False
    script: bool = True
    listens: bool = False
    slow_disk: bool = False
    plugged: bool = True
    autopilot: str = "ardupilot"
    mission: float | None = None
    deadman: bool = False
    delay: float = 0.0
    serial: bool = False
    brakes: bool = False
    half: float = LOOP.half


class Stage:
    """Starts field and companion, and ends them when the block ends.

    control, hand: the field's control channel, for one thread each. gcs: the url of the autopilot's second
    port.
    """

    def __init__(self, out: Path, plan: Plan, cancelled: threading.Event) -> None:
        self.out, self.plan = out, plan
        self._cancelled = cancelled
        self._closing = ExitStack()
        self.speed = plan.speed
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
        asked += ["--autopilot", plan.autopilot, "--half-width", f"{plan.half:.2f}"]
        asked += [] if plan.mission is None else ["--mission", f"{plan.mission:.1f}"]
        self._driving = AUTOPILOTS[plan.autopilot].mission.name
        field = self._child("field", ["bench.stopping.field", *asked])
        ports: dict[str, Any] = json.loads(field.first_line(READY_WITHIN))
        if plan.script and ports["script"] != "running":
            raise RuntimeError(f"the script on the autopilot is {ports['script']}")
        host, _, port = ports["control"].rpartition(":")
        self.control = self._closing.enter_context(FieldControl(host, int(port)))
        self.hand = self._closing.enter_context(FieldControl(host, int(port)))
        port = ports["companion"].rpartition(":")[2]
        self.wire = self._closing.enter_context(
            closing(Wire(int(port), calls=plan.listens or plan.serial, delay=plan.delay))
        )
        url, self.serial = self.wire.url, None
        if plan.serial:
            port = url.rpartition(":")[2]
            self.serial = self._closing.enter_context(closing(SerialDevice(int(port))))
            url = self.serial.url
        self.disk = SlowDisk(self.out) if plan.slow_disk else None
        self.camera = self._closing.enter_context(closing(CameraRelay(ports["frames"], plugged=plan.plugged)))
        self.gcs = ports["gcs"]
        self.ground = self._closing.enter_context(closing(SecondPort(self.gcs)))
        self.config = self._write_config(self.camera.source, url)
        if plan.deadman:
            self.control.ask("transmitter", on=False)
            for name, value in GUARDED.items():
                self.ground.set_of_autopilot(name, value)
        perceivers.register()
        self.freshness = load_config(str(self.config)).freshness
        self.start_daemon()

    def __enter__(self) -> Stage:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Ends all processes, whatever state they are in."""
        self._closing.close()

    def start_daemon(self) -> None:
        """Starts a companion with the configuration; an earlier one must be dead."""
        (self.out / "state" / "status.json").unlink(missing_ok=True)
        module = "bench.stopping.perceivers" if self.plan.breakable else "companion"
        environment = self.disk.environment if self.disk is not None else {}
        self.daemon = self._child("daemon", [module, "run", str(self.config)], environment)

    def start_operator(self) -> LoggedProcess:
        """Starts the operator's terminal, into which lines can be typed; its lines are its events as JSON."""
        operator = start_operator(self.gcs, self.out, auto=True)
        self._closing.callback(_end, operator)
        return operator

    def break_perceiver(self, how: str) -> None:
        """Breaks the perceiver from now on, in a way of bench.stopping.perceivers; "" mends it."""
        write_atomically(self.out / "fault", how.encode(), sync=False)

    def freeze_camera(self, *, on: bool) -> None:
        """Makes the camera deliver nothing."""
        self.control.ask("freeze_camera", on=on)

    def set_speed(self, speed: float) -> None:
        """Sets the speed along the trail in m/s, at most the plan's."""
        self.speed = speed
        self.ground.set_speed(speed)

    def status(self) -> dict[str, Any]:
        """Returns the field's status."""
        return self.control.status()

    def read_status(self) -> dict[str, Any]:
        """Reads the companion's status file; empty while there is none."""
        return read_status(self.out / "state")[1]

    @property
    def log(self) -> str:
        """What the companions of this stage logged."""
        return (self.out / "daemon.log").read_text(encoding="utf-8", errors="replace")

    def held_for(self) -> str:
        """The reasons of the companion's first hold, as its log says them; "" where it held nothing."""
        found = re.search(r"hold \d+: ([a-z_, ]+)$", self.log, re.M)
        return found[1] if found else ""

    def wait(self, what: str, fits: Callable[[], bool], limit: float) -> None:
        """Waits until `fits`. Raises Disturbed after `limit` s, or when a process has ended."""
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
        """Waits until the companion sees, and the autopilot has received a heartbeat that says so.

        If AUTO is set before that, the script takes it that the driver wants to drive blind, and does not
        hold.
        """
        since, heard = time.time(), time.monotonic()
        self.wait("a companion that is well", lambda: (self.wire.believed() or 0.0) > heard, READY_WITHIN)
        self.wait("its status", lambda: self._well_after(since), READY_WITHIN)

    def _well_after(self, since: float) -> bool:
        age, status = read_status(self.out / "state")
        return age is not None and time.time() - age > since and status.get("state") in ("ok", "holding")

    def drive(self, longer: float = 0.0) -> None:
        """Arms, sets AUTO by hand, and drives until `longer` s at cruise speed are over."""
        self.control.start()
        self.wait("driving", self._is_driving, DRIVING_WITHIN)
        until = time.monotonic() + longer
        self.wait("driving on", lambda: time.monotonic() >= until, longer + 1.0)
        status = self.status()
        if status["mode"] != self._driving:
            raise Disturbed(f"it stood already: {status['mode_log'][-1]}")

    def _is_driving(self) -> bool:
        status = self.status()
        if status["mode"] != self._driving:
            raise Disturbed(f"it was held: {status['mode_log'][-1]}")
        return bool(status["speed"] > 0.95 * self.speed)

    def measure(
        self,
        fault: Callable[[], None],
        noticed: float = 0.0,
        *,
        silences: bool = False,
        mode: str = "",
        most: float = math.inf,
    ) -> Stop:
        """Measures the stop after a fault that begins now. noticed, silences: as of `InjectedFault`.

        mode: that must stand; by default the mission's. most: as of `Limit`.
        """
        before = self.status()
        if before["mode"] != (mode or self._driving):
            raise Disturbed(f"it stood already: {before['mode_log'][-1]}")
        taken_at, begun = self.camera.taken_at, time.monotonic()
        fault()
        # One that has begun to drive backwards still gathers speed.
        speed = before["speed"] if before["speed"] > 0.0 else self.speed
        limit = Limit(max(self.freshness, noticed), script_timeout(), speed, most)
        until = before["t"] + limit.seconds + BEYOND
        after = self.status()
        while abs(after["speed"]) > STANDSTILL and after["t"] < until:
            if self._cancelled.is_set():
                raise KeyboardInterrupt
            time.sleep(LOOK)
            after = self.status()
        time.sleep(STAYS)
        stop = stopped(before, after, limit, self.status())
        changed_at = stop.changed_at
        if silences:
            last_ok, ordered = self.wire.believed(changed_at), changed_at
        else:
            last_ok, ordered = taken_at, min(changed_at, self.wire.ordered(begun) or math.inf)
        hold = ordered - last_ok if last_ok is not None and ordered < math.inf else None
        return replace(stop, hold=hold, speed=speed, gap=self.wire.longest_gap(begun, time.monotonic()))

    def measure_reversed(self) -> Stop:
        """Reverses the mission, measures the stop from where it drives backwards, and lets it drive forward.

        Nothing but an answer ends that fault: a go is given, and the time until all is well counts from it.
        """
        if self.read_status().get("policy") != self.plan.policy:
            raise Disturbed(f"it may not hold: {self.read_status().get('hold_refused')}")
        self.ground.reverse(on=True)
        self.wait("driving backwards", lambda: bool(self.status()["speed"] < -BACKWARDS), DRIVING_WITHIN)
        stop = self.measure(lambda: None, WAY / self.speed)
        if not stop.stands:
            return stop
        if "fault: drives backwards" not in self.log:
            raise Disturbed("it was held for something else")
        self.wait("the id of its hold", lambda: bool(self.read_status().get("current_id")), READY_WITHIN)
        self.ground.reverse(on=False)
        answered = time.monotonic()
        self.ground.go(int(self.read_status()["current_id"]))
        return replace(stop, returned=self.returned(answered))

    def returned(self, since: float) -> float | None:
        """Returns s from `since` until the companion reported itself well again; None: not within 15 s."""
        with contextlib.suppress(Disturbed):
            self.wait("a return", lambda: self.wire.well_again(since) is not None, RETURN_WITHIN)
        return self.wire.well_again(since)

    def _child(
        self, name: str, arguments: list[str], environment: Mapping[str, str] | None = None
    ) -> LoggedProcess:
        log = self.out / f"{name}.log"
        child = LoggedProcess(name, arguments, log, orphaned=signal.SIGKILL, environment=environment)
        self._closing.callback(_end, child)
        return child

    def _write_config(self, camera: str, link: str) -> Path:
        plan = self.plan
        guide = plan.policy == "guide"
        speed = plan.speed / _OVERSHOOTS if guide else plan.speed
        path = write_config(self.out, camera=camera, link=link, policy=plan.policy, speed=speed, guide=guide)
        text = path.read_text(encoding="utf-8")
        if plan.quiet:
            text = text.partition("[words]")[0].replace("top = 0.46", "top = 0.44") + _QUIET
        if plan.brakes:
            text = text.replace("[stopping]\n", '[stopping]\nhold_by = "brake"\n')
        if plan.deadman:
            text = text.replace("[call]\n", '[call]\npx4_deadman = "manual_control"\n')
        name = f"broken:{self.out / 'fault'}" if plan.breakable else "builtin"
        text += f"\n[perceiver]\nname = {json.dumps(name)}\nthreads = 1\n"
        path.write_text(text, encoding="utf-8")
        return path


def _end(child: LoggedProcess) -> None:
    """Ends a process, whatever state it is in."""
    child.process.kill()
    child.stop()
