"""Feeds mutated frames to the link: no exception escapes, strangers change nothing, memory stays flat."""

from __future__ import annotations

import gc
import math
import sys
import tracemalloc
from collections import Counter
from dataclasses import dataclass, field
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from anytraverse.operations import ForgetCall, ForgetWord, NewEpisode, OtherPlace, SetWord, Tap
from anytraverse.regions import Box
from bench.link.mutants import ALLOWED, OURS, Crowd, Mutants
from companion.calls.mode_monitor import ModeAnswer
from companion.config.link_settings import MAIN, LinkSettings
from companion.config.video import CameraSettings
from companion.guide.rules import GuideAnswer
from companion.link.camera import Tapped
from companion.link.inbound import (
    InboundEvent,
    ParameterRequest,
    PolicyRequest,
    RcChannels,
    ResetRequest,
    VehicleUpdate,
)
from companion.link.link import Link
from companion.link.parser import Parser
from companion.sim.loopback_link import pair
from companion.storage.served_tree import Document, Documents, Tree
from companion.vehicle.ardupilot import ScriptHold
from companion.wire.answers import Acknowledgement, Answer, CancelIncident, PackIncident, Via
from companion.wire.ids import (
    AUTOPILOT_COMPONENT_ID,
    CAMERA_COMPONENT_ID,
    Motion,
    Outcome,
    Policy,
    Reasons,
    Result,
    Stage,
)
from companion.wire.parameters import build

BATCH = 64
CALM = 350
_TICKS, _TICK = 6, 0.02
WARM_UP = 0.3
"""Share of the frames after which memory must not grow."""
GROWTH = 128 * 1024
MORE_BLOCKS = 4000
"""Bytes and blocks by which it may grow, for tables of bounded size that are not full at first."""
SILENCE = 1.5
"""s at most between two heartbeats, except for 10 s after another component 191 was heard."""
CLASH = 11.5


class Broken(AssertionError):  # noqa: N818
    """Raised when the link broke a promise; the message says which."""


@dataclass
class Fuzzed:
    """The result. frames: fed in. requests: let through, by kind. sent: the link's messages, by type.

    rejected: the link's own counts. growth, blocks: memory taken after the warm-up; bytes only if traced.
    """

    frames: int = 0
    requests: Counter[str] = field(default_factory=Counter)
    sent: Counter[str] = field(default_factory=Counter)
    rejected: dict[str, int] = field(default_factory=dict)
    bad: int = 0
    growth: int = 0
    blocks: int = 0

    def figures(self) -> dict[str, Any]:
        """For the report."""
        return {**vars(self), "requests": dict(self.requests), "sent": dict(self.sent)}


class Fuzz:
    """A link, an autopilot with a heartbeat a second, and a daemon that grants every request."""

    def __init__(self, seed: int) -> None:
        self.now = 0.0
        self.told = Fuzzed()
        self._mutants = Mutants(seed)
        self._near, self._far = pair()
        self._listed = build(["grass", "dry bush"], {"grass": 1.0}, {})
        settings = LinkSettings("udpout:127.0.0.1:14550", asked_budget=0.0, pace=0.0, allowed_senders=ALLOWED)
        openers = {MAIN: lambda: self._near}
        self._link = Link(
            settings,
            self._listed,
            self.now,
            openers=openers,
            tree=_tree(),
            camera=CameraSettings(CAMERA_COMPONENT_ID, 5.0, 75),
            clock=lambda: self.now,
        )
        self._link.camera.size, self._link.camera.url = (480, 640), "rtsp://rover.local:8554/anytraverse"
        self._link.camera.resolve = _tapped
        self._parser = Parser()
        self._autopilot = mavlink.MAVLink(None, OURS, AUTOPILOT_COMPONENT_ID)
        self._heartbeat_at = 0.0
        self._beat_at = self._clash_at = -math.inf
        self._clashes = 0

    def run(self, frames: int, *, traced: bool = False) -> Fuzzed:
        """Feeds in mutated frames, batch by batch. traced: counts bytes too, which is five times as slow.

        Raises Broken, and any exception that escapes the link.
        """
        if traced:
            tracemalloc.start()
        try:
            blocks, size = self._until(int(frames * WARM_UP))
            blocks_after, size_after = self._until(frames)
        finally:
            tracemalloc.stop()
        self.told.blocks, self.told.growth = blocks_after - blocks, size_after - size
        if self.told.blocks > MORE_BLOCKS or self.told.growth > GROWTH:
            raise Broken(f"memory grew by {self.told.growth} bytes, {self.told.blocks} blocks")
        counters = self._link.counters
        self.told.rejected, self.told.bad = dict(counters.rejected), counters.bad
        return self.told

    def _until(self, frames: int) -> tuple[int, int]:
        """Feeds in frames up to a number; returns the blocks (and bytes, if traced) then in use."""
        while self.told.frames < frames:
            self._batch("strangers" if self.told.frames // BATCH % 2 else "all")
        for _ in range(CALM):  # queues empty themselves, and what is half transferred or open times out
            self._step()
        gc.collect()
        return sys.getallocatedblocks(), tracemalloc.get_traced_memory()[0]

    def _batch(self, crowd: Crowd) -> None:
        self._step()
        before = self._state()
        for _ in range(BATCH):
            self._far.write(self._mutants.next(crowd))
        self.told.frames += BATCH
        heard = self._link.poll(self.now)
        if crowd == "strangers" and (heard or self._state() != before):
            raise Broken(f"a stranger got through: {heard}")
        for event in heard:
            self._grant(event)
        self._watch_clash()

    def _step(self) -> None:
        """Lets a moment pass: the autopilot's heartbeat comes in, and all that the link sends is checked."""
        for _ in range(_TICKS):
            self.now += _TICK
            if self.now >= self._heartbeat_at:
                self._heartbeat_at = self.now + 1.0
                message = mavlink.MAVLink_heartbeat_message(10, 3, 129, 10, 4, 3)
                self._far.write(message.pack(self._autopilot))
            for event in self._link.poll(self.now):
                if not isinstance(event, VehicleUpdate):
                    raise Broken(f"from a heartbeat: {event}")
            self._link.tick(self.now)
        while data := self._far.read():
            for message in self._parser.feed(data, self.now, whole=True):
                self.told.sent[message.get_type()] += 1
                if message.get_type() == "HEARTBEAT":
                    self._beat_at = self.now
        if self._parser.bad:
            raise Broken("the link sent a broken frame")
        if self.now - self._beat_at > SILENCE and self.now - self._clash_at > CLASH and self.now > SILENCE:
            raise Broken(f"no heartbeat for {self.now - self._beat_at:.1f} s")

    def _watch_clash(self) -> None:
        clashes = self._link.counters.rejected.get("clash", 0)
        if clashes != self._clashes:
            self._clashes, self._clash_at = clashes, self.now

    def _state(self) -> object:
        vehicle = self._link.vehicle
        mode = vehicle and (
            vehicle.system_id,
            vehicle.autopilot,
            vehicle.type,
            vehicle.custom_mode,
            vehicle.armed,
        )
        return mode, [self._link.parameters.value(one.name) for one in self._listed]

    def _grant(self, event: InboundEvent) -> None:
        if isinstance(event, VehicleUpdate | RcChannels | ModeAnswer | GuideAnswer | ScriptHold):
            return
        if not ALLOWED[0] <= event.sender[0] <= ALLOWED[1]:
            raise Broken(f"not from one that may: {event}")
        if not well_formed(event, {one.name for one in self._listed}):
            raise Broken(f"not well-formed: {event}")
        kind = event.via.value if isinstance(event, Answer) else type(event).__name__
        self.told.requests[kind] += 1
        link, now = self._link, self.now
        match event:
            case Answer():
                link.answers.acknowledge(event, _granted(event), now)
            case ParameterRequest(name=name, value=value):
                link.parameters.set_value(name, value, now)
            case ResetRequest() | PolicyRequest():
                link.commands.acknowledge(event, mavlink.MAV_RESULT_ACCEPTED, now)


def well_formed(event: InboundEvent, names: set[str]) -> bool:
    """Whether a request that reached the daemon is well-formed."""
    match event:
        case Answer(via=Via.TEXT, operations=operations):
            return 0 < len(operations) <= 16 and all(map(_is_operation, operations))
        case Answer(target=target, motion=motion, operations=operations):
            numbered = (event.via is Via.TUNNEL) == (event.transaction != 0)
            whole = isinstance(motion, Motion) and 0 <= target <= 0xFFFF and numbered
            return whole and all(map(_is_operation, operations))
        case ParameterRequest(name=name, value=value):
            return name in names and math.isfinite(value)
        case PolicyRequest(policy=policy):
            return isinstance(policy, Policy)
        case _:
            return True


def _is_operation(operation: object) -> bool:
    match operation:
        case SetWord(word, weight):
            return isinstance(word, str) and -1.0 <= weight <= 1.0
        case Tap(frame_id, box, word, weight):
            left, top, right, bottom = box
            inside = 0.0 <= left < right <= 1.0 and 0.0 <= top < bottom <= 1.0
            return inside and frame_id >= 0 and isinstance(word, str) and -1.0 <= weight <= 1.0
        case ForgetWord() | ForgetCall() | NewEpisode() | OtherPlace() | PackIncident() | CancelIncident():
            return True
        case _:
            return False


def _granted(request: Answer) -> Acknowledgement:
    number = request.transaction
    return Acknowledgement(
        number,
        request.target,
        Result.APPLIED,
        Stage.CLOSED,
        Outcome.ANSWERED,
        0.1,
        0.2,
        Reasons.NONE,
        1,
        "C1",
    )


def _tapped(tapped: Tapped, _now: float) -> Answer | str:
    x, y = tapped.centre if isinstance(tapped, Box) else tapped
    if x < 0.1:
        return "no call is open"
    box = tapped if isinstance(tapped, Box) else Box(0.9 * x, 0.9 * y, 0.9 * x + 0.1, 0.9 * y + 0.1)
    sides = box.left, box.top, box.right, box.bottom
    return Answer(7, Motion.NONE, (Tap(3, sides, "obstacle", -1.0),))


def _tree() -> Tree:
    return Tree(
        {
            "state.json": Document(lambda: b'{"words": {}}' * 40),
            "calls": Documents(lambda: {"1.json": 300}, lambda _: b"x" * 300),
        }
    )
