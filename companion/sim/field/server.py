"""Runs the field: one loop for physics, autopilot and control, and one thread that renders."""

from __future__ import annotations

import math
import selectors
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from companion.cameras.field import CapturedFrame
from companion.sim.field.album import Album
from companion.sim.field.autopilot import SimulatedAutopilot
from companion.sim.field.control import ControlServer
from companion.sim.field.frame_server import FrameServer
from companion.sim.field.motion import LEVEL, RoverMotion, Tilt
from companion.sim.field.onboard import install
from companion.sim.field.ports import UdpPort
from companion.sim.field.px4 import Px4
from companion.sim.field.requests import ControlRequests
from companion.sim.field.router import Port
from companion.sim.field.simulation import Simulation

if TYPE_CHECKING:
    from companion.sim.field.things import World
    from companion.sim.field.trail import TrailPose


TICK = 0.02
AUTOPILOTS: Mapping[str, type[SimulatedAutopilot]] = {"ardupilot": SimulatedAutopilot, "px4": Px4}


class Renders(Protocol):
    """A camera: renders RGB (H, W, 3) uint8 and labels (H, W) uint8 at a pose, rover time in s and tilt."""

    def render(
        self, pose: TrailPose, t: float, tilt: Tilt = LEVEL
    ) -> tuple[NDArray[np.uint8], NDArray[np.uint8]]: ...


@dataclass(frozen=True)
class FieldOptions:
    """How the field runs. `fps`: of the camera. `speed`: m/s. `duration`: s, None: until it is stopped.

    `script`: whether the autopilot runs the shipped script. `autopilot`: a key of `AUTOPILOTS`. `mission`: m
    of the trail after which the mission is complete; None: it goes round. `swing`, `bumps`, `slopes`: as of
    `RoverMotion`, in degrees. `distortion`: k1 of the camera's view. `port`: of the companion's link; the
    ground's and the frames' are the next two; 0: free ones.
    """

    seed: int = 1
    fps: float = 12.0
    speed: float = 2.5
    autostart: bool = False
    duration: float | None = None
    script: bool = True
    autopilot: str = "ardupilot"
    mission: float | None = None
    swing: float = 0.0
    bumps: float = 0.0
    slopes: float = 0.0
    distortion: float = 0.0
    port: int = 0

    def ports(self) -> tuple[int, int, int]:
        """Return the ports of the companion, of the ground and of the frames, 0: free ones."""
        return (self.port, self.port + 1, self.port + 2) if self.port else (0, 0, 0)


class FieldServer:
    """Binds its sockets to ports of 127.0.0.1 when it is made; `run` serves until `stop`."""

    def __init__(self, world: World, camera: Renders, options: FieldOptions) -> None:
        self._options = options
        self._camera = camera
        self._stopping = threading.Event()
        self._frozen = threading.Event()
        self._failure: Exception | None = None
        self._drawn = 0
        self._period = 1.0 / options.fps
        companion, ground, frames = options.ports()
        self._ports = {Port.COMPANION: UdpPort(companion), Port.GCS: UdpPort(ground)}
        self._simulation = Simulation(
            world,
            self._send,
            cruise_speed=options.speed,
            autopilot=AUTOPILOTS[options.autopilot],
            mission=options.mission,
            motion=RoverMotion(
                world.trail,
                world.seed,
                swing=math.radians(options.swing),
                bumps=math.radians(options.bumps),
                slopes=math.radians(options.slopes),
            ),
        )
        self.no_script = "--no-script"
        if options.autopilot == "px4":
            self.no_script = "PX4 runs none"
        elif options.script:
            self.no_script = install(self._simulation.autopilot)
        self._frames = FrameServer(port=frames)
        self._album = Album(world, options.distortion)
        self._selector = selectors.DefaultSelector()
        requests = ControlRequests(
            self._simulation,
            status=self.status,
            look=self._album.look,
            freeze=self._freeze,
            film=self._film,
            stop=self.stop,
        )
        self._control = ControlServer(self._selector, requests.handle)
        for port, udp in self._ports.items():
            self._selector.register(udp.socket, selectors.EVENT_READ, lambda _, at=port: self._listen(at))
        if options.autostart:
            requests.start()

    def addresses(self) -> dict[str, Any]:
        """Returns the addresses that the process prints at its start."""
        return {
            "companion": f"udpout:127.0.0.1:{self._ports[Port.COMPANION].number}",
            "gcs": f"udpout:127.0.0.1:{self._ports[Port.GCS].number}",
            "frames": "{}:{}".format(*self._frames.address),
            "control": "{}:{}".format(*self._control.address),
            "script": f"not running: {self.no_script}" if self.no_script else "running",
            "seed": self._options.seed,
        }

    def stop(self) -> None:
        """Ends `run`; may be called from a signal handler or another thread."""
        self._stopping.set()

    def run(self) -> None:
        """Serves until `stop` is called or the duration is over, then closes every socket.

        Raises what the camera raised: without pictures the field ends.
        """
        begun = last = time.monotonic()
        artist = threading.Thread(target=self._draw, name="camera", daemon=True)
        artist.start()
        try:
            while not self._stopping.is_set():
                events = self._selector.select(max(0.0, last + TICK - time.monotonic()))
                now = time.monotonic()
                # Time passes before the new frames are read: until now the old orders were in force.
                self._simulation.advance(now - last)
                last = now
                for key, mask in events:
                    key.data(mask)
                self._simulation.autopilot.poll(now)
                if self._options.duration is not None and now - begun >= self._options.duration:
                    self.stop()
        finally:
            self.stop()
            artist.join(timeout=2.0)
            self.close()
        if self._failure is not None:
            raise self._failure

    def close(self) -> None:
        self._control.close()
        self._frames.close()
        for udp in self._ports.values():
            udp.close()
        self._selector.close()

    def status(self) -> dict[str, Any]:
        """Returns the simulation's status, bytes on both ports, frames drawn and the monotonic time in s."""
        counts = {port.value: {"in": udp.bytes_in, "out": udp.bytes_out} for port, udp in self._ports.items()}
        counts[Port.GCS.value]["from_companion"] = self._simulation.autopilot.bytes_from_companion
        return {
            **self._simulation.status(),
            "bytes": counts,
            "frames": self._drawn,
            "camera_frozen": self._frozen.is_set(),
            "monotonic": time.monotonic(),
        }

    def _send(self, port: Port, frame: bytes) -> bool:
        return self._ports[port].send(frame)

    def _listen(self, port: Port) -> None:
        autopilot = self._simulation.autopilot
        for frame in self._ports[port].read(lambda datagram: autopilot.pass_to_script(port, datagram)):
            autopilot.receive(port, frame)

    def _freeze(self, on: bool) -> None:
        if on:
            self._frozen.set()
        else:
            self._frozen.clear()

    def _film(self, fps: float) -> None:
        self._period = 1.0 / fps

    def _draw(self) -> None:
        due = time.monotonic()
        try:
            while not self._stopping.wait(max(0.0, due - time.monotonic())):
                # A slow renderer drops frames instead of falling behind.
                due = max(due + self._period, time.monotonic())
                if not self._frozen.is_set():
                    self._draw_one()
        except Exception as reason:
            self._failure = reason
            self.stop()

    def _draw_one(self) -> None:
        rover = self._simulation.rover
        with self._simulation.lock:
            captured_at = time.monotonic()
            pose, tilt = rover.pose, rover.attitude.tilt
            rgb, labels = self._camera.render(pose, rover.time, tilt)
        self._drawn += 1
        self._album.keep(captured_at, pose, labels, tilt)
        self._frames.publish(CapturedFrame(self._drawn, captured_at, rgb))
