"""Runs the composed daemon and the simulated autopilot with its script in virtual time, in one process.

The eyes see grass everywhere, so that ways are planned as always. That the mission's way is blocked, is
played.
"""

from __future__ import annotations

from collections import deque
from pathlib import Path
from random import Random
from typing import Any, NamedTuple

import numpy as np
from pymavlink.dialects.v20 import development as mavlink

from anytraverse.engine import AnyTraverse
from anytraverse.frame import Frame
from anytraverse.memory import Memory, first_memory
from bench.virtual_time import Clock
from companion.cameras.newest import CameraState, CameraStatus
from companion.config import load_config
from companion.config.stopping import longest_brake
from companion.daemon.composition import Resources, compose
from companion.daemon.settings.runtime import first_values
from companion.desk.exchange.truth import TruePerceiver
from companion.link.answer_store import AnswerStore
from companion.sim.demo.config import write_config
from companion.sim.field.autopilot import COMPANION, HAND
from companion.sim.field.modes import Mode
from companion.sim.field.onboard import install
from companion.sim.field.render import LABELS
from companion.sim.field.router import DatagramParser, Port
from companion.sim.field.simulation import Simulation
from companion.sim.field.things import World
from companion.sim.loopback_link import LoopbackLink
from companion.sim.loopback_vision import LoopbackVision
from companion.storage import Journal
from companion.storage.served_files import ServedFiles
from companion.storage.writer import Writer
from companion.tasks import VISION
from companion.vision.client import VisionClient
from companion.vision.messages import Planned, Report
from companion.vision.warm_up import judging_settings
from companion.wire.ids import MODE_REQUEST_COMMAND
from companion.wire.parameters import build

TICK, COARSE = 0.01, 0.02
"""s, and before anything happens."""
SPEED, RATE, JUDGED = 1.2, 5.0, 0.05
"""m/s, frames/s, and s from a frame's capture until it is judged."""
BLOCKED = 2.0
"""m of the mission's way that are clear where it is played to be blocked."""
_ROWS, _COLUMNS = 48, 64
_STATION: Any = mavlink.MAVLink(None, 255, 190)


class Asked(NamedTuple):
    """A request of the companion's for a mode. at: s of the clock when it left."""

    at: float
    mode: int


class _Eyes(LoopbackVision):
    """Reports the plans of the real worker, with the way blocked while `blocked`."""

    blocked = False

    def report(self, report: Report) -> None:
        if isinstance(report, Planned) and self.blocked:
            clear = min(report.content.route_clear, BLOCKED)
            report = Planned(report.content._replace(route_blocked=True, route_clear=clear))
        super().report(report)


class GuidedRover:
    """A rover in AUTO with a companion in policy guide. Times are s of the clock.

    asked: the companion's requests for modes so far. targets: when a target of ours that moves the rover was
    obeyed. eyes.blocked: whether the mission's way is blocked.
    """

    def __init__(self, folder: Path, clock: Clock, random: Random, delay: float) -> None:
        """delay: s that the wire takes, each way. random: for phases, which no two runs share."""
        self.clock, self._delay = clock, delay
        self._up: deque[tuple[float, bytes]] = deque()
        self._down: deque[tuple[float, bytes]] = deque()
        self.asked: list[Asked] = []
        self.targets: list[float] = []
        self._set_autopilot(random)
        self._set_companion(folder)
        self._frames, self._grain = 0, np.random.default_rng(0)
        self._film_at = clock.now + random.uniform(0.0, 1.0 / RATE)
        self._judged: Frame | None = None

    def _set_autopilot(self, random: Random) -> None:
        world = World(1, ())
        world.trail.start = random.uniform(0.0, world.trail.length)
        world.things.clear()
        self.simulation = Simulation(world, self._sent, cruise_speed=SPEED)
        self.autopilot = self.simulation.autopilot
        missing = install(self.autopilot)
        if missing:
            raise RuntimeError(missing)
        self.simulation.advance(random.uniform(0.0, 0.1))
        hear = self.autopilot.targets.hear

        def heard(frame: Any) -> None:
            if frame.get_srcComponent() == COMPANION and (frame.vx or frame.yaw_rate):
                self.targets.append(self.clock.now)
            hear(frame)

        self.autopilot.targets.hear = heard  # type: ignore[method-assign]

    def _set_companion(self, folder: Path) -> None:
        folder.mkdir(parents=True)
        path = write_config(
            folder,
            camera="folder:none",
            link="udpout:127.0.0.1:1",
            policy="guide",
            speed=SPEED,
            rate=RATE,
            guide=True,
        )
        self._config = config = load_config(str(path))
        journal, served = Journal(config.journal.path), ServedFiles(config.journal.path)
        listed = build(config.vocabulary, config.words, first_values(config), aliases=config.aliases)
        self._stage = LoopbackLink(
            parameters=listed, vehicle=None, tree=served.tree, answer_store=AnswerStore(None)
        )
        self._stage.link.modes.brake = longest_brake(config)
        self._writer = Writer(journal)
        vision = VisionClient(self._launch, config, None, VISION)
        for _ in range(3):
            vision.poll(self.clock.now)
            self.eyes.work()
        assert vision.ready is not None
        opened = Resources(self._stage.link, vision, journal, self._writer, served, {})
        self.daemon = compose(config, opened, vision.ready, [])
        self._close = vision.close, journal.close

    def close(self) -> None:
        """Ends the companion."""
        for close in self._close:
            close()

    @property
    def time(self) -> float:
        """The rover's time in s, as in the mode log."""
        return self.simulation.rover.time

    def start(self) -> None:
        """Arms, and sets AUTO by hand."""
        self.autopilot.arm(on=True)
        self.autopilot.set_mode(Mode.AUTO, HAND)

    def click(self, message: Any) -> None:
        """A message of a ground station arrives at the autopilot."""
        frame = message.pack(_STATION)
        self.autopilot.pass_to_script(Port.GCS, frame)
        for parsed in DatagramParser().frames(frame):
            self.autopilot.receive(Port.GCS, parsed)

    def step(self, seconds: float, act: Any = None, *, first: bool = False) -> None:
        """Lets a tick of so many s pass. act: what a human does in it.

        first: before frames of the companion arrive.
        """
        clock = self.clock
        clock.now += seconds
        self.simulation.advance(seconds)
        if act and first:
            act()
        while self._up and self._up[0][0] <= clock.now:
            frame = self._up.popleft()[1]
            self.autopilot.pass_to_script(Port.COMPANION, frame)
            for parsed in DatagramParser().frames(frame):
                self.autopilot.receive(Port.COMPANION, parsed)
        if act and not first:
            act()
        self.autopilot.poll(clock.now)
        while self._down and self._down[0][0] <= clock.now:
            self._stage.far.write(self._down.popleft()[1])
        self._see()
        self.daemon.daemon.turn()
        self._writer.drain()
        while frame := self._stage.far.read():
            self._up.append((clock.now + self._delay, frame))
            self._note(frame)

    def _sent(self, port: Port, frame: bytes) -> bool:
        if port is Port.COMPANION:
            self._down.append((self.clock.now + self._delay, frame))
        return True

    def _note(self, frame: bytes) -> None:
        for parsed in DatagramParser().frames(frame):
            if (
                parsed.get_type() == "COMMAND_LONG"
                and parsed.command == MODE_REQUEST_COMMAND
                and parsed.param1
            ):
                self.asked.append(Asked(self.clock.now, round(parsed.param3)))

    def _see(self) -> None:
        """Films, and judges what was filmed a while ago."""
        now = self.clock.now
        self.eyes.work()
        if self._judged is not None and now >= self._judged.captured_at + JUDGED:
            self.eyes.live(CameraStatus(CameraState.DELIVERING), self._judged.captured_at)
            self.eyes.judge(self._judged)
            self._judged = None
        if now >= self._film_at:
            self._film_at += 1.0 / RATE
            self._frames += 1
            image = self._grain.integers(70, 180, (_ROWS, _COLUMNS, 3), dtype=np.uint8)
            self._judged = Frame(self._frames, now, image)

    def _launch(self) -> LoopbackVision:
        self.eyes = _Eyes(self._engine)
        return self.eyes

    def _engine(self, memory: Memory | None) -> AnyTraverse:
        perceiver, config = TruePerceiver(), self._config
        perceiver.show(np.full((_ROWS, _COLUMNS), LABELS.index("grass"), np.uint8))
        settings = judging_settings(config, perceiver)
        return AnyTraverse(
            perceiver, settings, memory or first_memory(perceiver.model_id, config.preferences)
        )
