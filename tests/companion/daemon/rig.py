"""A whole daemon in virtual time; only camera and radio are played.

`tests.companion.processes` runs it in processes of its own instead.
"""

from __future__ import annotations

import sqlite3
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import development as mavlink

from anytraverse.engine import AnyTraverse
from anytraverse.frame import Frame
from anytraverse.memory import Memory, first_memory
from anytraverse.operations import Operation, SetWord
from anytraverse.preferences import Preferences
from bench.virtual_time import Clock
from companion.cameras.newest import CameraState, CameraStatus
from companion.config import Config
from companion.config.schema import StoppingSection
from companion.config.video import CameraSettings
from companion.daemon.composition import Resources, compose
from companion.link.answer_store import AnswerStore
from companion.sim.loopback_link import LoopbackLink
from companion.sim.loopback_vision import LoopbackVision
from companion.storage import Journal
from companion.storage.served_files import ServedFiles
from companion.storage.writer import Writer
from companion.tasks import VISION
from companion.vision.client import VisionClient
from companion.vision.warm_up import judging_settings
from companion.wire import notices
from companion.wire.answers import Acknowledgement, Answer
from companion.wire.ids import (
    COMPONENT_ID,
    MODE_REQUEST_COMMAND,
    TUNNEL_ACKNOWLEDGEMENT,
    TUNNEL_ANSWER,
    Motion,
    Policy,
    read_heartbeat_mode,
)
from companion.wire.parameters import ROI, build
from tests.anytraverse.conftest import AHEAD, CODES, GNOME, HEIGHT, WIDTH, Painted

AUTO, HOLD, MANUAL = 10, 4, 0
PERIOD = 0.1
WORDS = Preferences.parse("grass: 1; rock: -1")


class PlayedCamera:
    """What the vision process tells of its camera."""

    def __init__(self) -> None:
        self.status = CameraStatus(CameraState.DELIVERING)
        self.delivered_at: float | None = None


def picture(thing: str = "", ground: str = "grass", scene: int = 0) -> np.ndarray[Any, np.dtype[np.uint8]]:
    """A picture of `ground` with a `thing` ahead, in a scene at an angle in degrees."""
    image = np.zeros((HEIGHT, WIDTH, 3), dtype=np.uint8)
    image[..., 0], image[..., 1], image[..., 2] = CODES[ground], 200, scene
    if thing:
        image[..., 0][AHEAD.slices(HEIGHT, WIDTH)] = CODES.get(thing, GNOME)
    return image


def forget(folder: Path) -> None:
    """The frame of the open call is lost."""
    with sqlite3.connect(folder / "journal.db") as connection:
        connection.execute("DELETE FROM frame")
    connection.close()


class Rig:
    """`see` shows frames and lets time pass; `texts`, `acks` and `state` are what the ground heard."""

    config = Config(stopping=StoppingSection(unchecked=True))
    """Of it only what says whether the vehicle stops in time counts here."""
    mavlink_camera: CameraSettings | None = None

    def __init__(
        self,
        folder: Path,
        clock: Clock,
        policy: Policy = Policy.HOLD,
        pictures: int = 0,
        switch: int | None = None,
    ) -> None:
        self.folder, self.clock, self.policy, self.pictures = folder, clock, policy, pictures
        self.frame_id = 0
        self._grain = np.random.default_rng(0)
        self._pulses_at = 0.0
        self.hung = False
        self.fails = False
        """Whether the test makes the daemon survive an error; in all others none may happen."""
        self.disk_hangs = False
        """Nothing is written; else all is that was handed over in a turn, before the next."""
        self.switch = switch
        """The pulse of channel 7 in us; given, it is the off switch, and told five times a second."""
        self.step_time = 0.02
        self.latency = 0.02
        """Seconds from a frame's capture until it is judged."""
        self.roi = (1 / 3, 0.6, 2 / 3, 0.95)
        """Left, top, right and bottom as configured."""
        self.start()

    def start(self, *, mode: int = AUTO, forget_frame: bool = False) -> None:
        """A new process on the same folder; what the last one had in its hands is lost."""
        if forget_frame:
            forget(self.folder)
        now = self.clock.now
        config = self._config()
        self.served = ServedFiles(self.folder)
        listed = build(config.vocabulary, config.words, dict(zip(ROI.values(), self.roi, strict=True)))
        self.journal = Journal(self.folder)
        saved = self.journal.load_supervision() or {}
        answers = AnswerStore(saved.get("replies"))
        self.stage = LoopbackLink(
            parameters=listed, tree=self.served.tree, answer_store=answers, camera=self.mavlink_camera
        )
        self.stage.mode = mode
        self.stage.now = now
        self.perceiver = Painted()
        self.writer = Writer(self.journal)
        self.camera = PlayedCamera()
        memory, first_frame = self.journal.load_memory(), int(saved.get("frame_id", 0)) + 1
        self.vision = VisionClient(self._launch, config, memory, VISION, first_frame=first_frame)
        for _ in range(2):
            self.vision.poll(now)
            self.child.work()
        self.vision.poll(now)
        assert self.vision.ready is not None
        news: list[str] = []
        opened = Resources(self.stage.link, self.vision, self.journal, self.writer, self.served, saved)
        self.daemon = compose(config, opened, self.vision.ready, news)
        self.left_out = [notice for notice in news if notice != notices.stopping_unchecked()]
        assert not any("not restored" in notice or "shadow" in notice for notice in news)
        self.calls, self.persistence = self.daemon.calls, self.daemon.persistence
        self.loop = self.daemon.daemon
        self.records, self.frames = self.daemon.records, self.daemon.frames
        self.answer_handler, self.settings = self.daemon.answer_handler, self.daemon.settings

    def _config(self) -> Config:
        left, top, right, bottom = self.roi
        return replace(
            self.config,
            words=dict(WORDS),
            vocabulary=("grass", "rock", "drum"),
            camera=replace(self.config.camera, rate=1.0 / PERIOD),
            roi=replace(self.config.roi, left=left, top=top, right=right, bottom=bottom),
            call=replace(
                self.config.call, policy=self.policy.name.lower(), off_channel=7 * (self.switch is not None)
            ),
            journal=replace(self.config.journal, folder=str(self.folder)),
            pictures=replace(self.config.pictures, keep=self.pictures),
        )

    def _launch(self) -> LoopbackVision:
        self.child = LoopbackVision(self._make_engine, self.step_time)
        return self.child

    def _make_engine(self, memory: Memory | None) -> AnyTraverse:
        known = memory or first_memory(self.perceiver.model_id, WORDS)
        settings = judging_settings(self._config(), self.perceiver, misfit_allowed=True)
        self.engine = AnyTraverse(self.perceiver, settings, known)
        return self.engine

    def kill(self) -> None:
        """As kill -9 leaves it."""
        assert self.fails or notices.unexpected_error() not in self.texts, "an error was survived"
        self.vision.close()
        self.journal.close()

    def restart(self, *, forget_frame: bool = False) -> None:
        """kill -9 and a new process."""
        self.kill()
        self.start(mode=self.stage.mode, forget_frame=forget_frame)

    def see(self, seconds: float = 1.0, thing: str = "", ground: str = "grass", scene: int = 0) -> None:
        """Ten frames a second of this."""
        for _ in range(round(seconds / PERIOD)):
            self.frame_id += 1
            image = picture(thing, ground, scene)
            image[1:, :, 2] = self._grain.integers(0, 256, image.shape[:2])[1:]  # no two are alike
            self.step(Frame(self.frame_id, self.clock.now + PERIOD - self.latency, image))

    def wait(self, seconds: float) -> None:
        """No frames come."""
        for _ in range(round(seconds / PERIOD)):
            self.step(None)

    def step(self, frame: Frame | None) -> None:
        """A tenth of a second."""
        for _ in range(4):
            self.clock.now += PERIOD / 4
            self.turn()
        if frame is not None:
            self.camera.delivered_at = self.clock.now
        self.child.hung = self.hung
        self.child.live(self.camera.status, self.camera.delivered_at)
        self.child.work()
        if frame is not None:
            self.child.judge(frame)
        self.turn()

    def answer(
        self, target: int, motion: Motion = Motion.NONE, *operations: Operation, transaction: int = 7
    ) -> None:
        """An answer arrives from the ground."""
        payload = Answer(target, motion, operations, transaction).pack()
        padded = list(payload.ljust(128, b"\0"))
        message = mavlink.MAVLink_tunnel_message(1, 191, TUNNEL_ANSWER, len(payload), padded)
        self.stage.send(message)

    def word(self, target: int, word: str, weight: float, motion: Motion = Motion.NONE) -> None:
        """An answer of one word."""
        self.answer(target, motion, SetWord(word, weight))

    def set(self, name: str, value: float) -> None:
        """A PARAM_SET arrives."""
        self.stage.send(mavlink.MAVLink_param_set_message(1, 191, name.encode(), value, 9))

    @property
    def texts(self) -> list[str]:
        """All STATUSTEXTs since the start of this process."""
        return [message.text for message in self.stage.sent("STATUSTEXT")]

    @property
    def acks(self) -> list[Acknowledgement]:
        """All acknowledgements since the start of this process."""
        return [Acknowledgement.unpack(payload) for payload in self.stage.tunnels(TUNNEL_ACKNOWLEDGEMENT)]

    @property
    def state(self) -> tuple[str, int]:
        """State and open id of the newest heartbeat."""
        own = [one for one in self.stage.sent("HEARTBEAT") if one.get_srcComponent() == COMPONENT_ID]
        told = read_heartbeat_mode(own[-1].custom_mode)
        return told.state.name, told.current_id

    @property
    def told_policy(self) -> Policy:
        """The policy in the newest heartbeat."""
        return read_heartbeat_mode(self.stage.sent("HEARTBEAT")[-1].custom_mode).policy

    def echoes(self, name: str) -> list[float]:
        """The values of a parameter that were told."""
        found = [message for message in self.stage.sent("PARAM_VALUE") if message.param_id == name]
        return [round(message.param_value, 4) for message in found]

    def turn(self) -> None:
        stage = self.stage
        stage.now = self.clock.now
        if stage.vehicle is not None and stage.now >= stage._heartbeat_at:
            stage.heartbeat(stage.vehicle)
            stage._heartbeat_at = stage.now + 1.0
        if self.switch is not None and stage.now >= self._pulses_at:
            self._pulses_at = stage.now + 0.2
            widths = [1500] * 6 + [self.switch] + [1500] * 11
            stage.send(mavlink.MAVLink_rc_channels_message(0, 16, *widths, 255), (1, 1))
        before = len(stage.frames)
        self.daemon.test_call.look()
        self.loop.turn()
        if not self.disk_hangs:
            self.writer.drain()
        stage.collect(stage.now)
        for frame in stage.frames[before:]:
            if frame.message.get_type() != "COMMAND_LONG":
                continue
            if frame.message.command == 176:
                stage.mode = int(frame.message.param2)
                stage._heartbeat_at = stage.now
            if frame.message.command == MODE_REQUEST_COMMAND:  # no script runs on it
                answer = mavlink.MAVLink_command_ack_message(MODE_REQUEST_COMMAND, 3, 0, 0, 1, COMPONENT_ID)
                stage.send(answer, (1, 1))


MakeRig = Callable[..., Rig]


def spoil(rig: Rig, monkeypatch: pytest.MonkeyPatch, error: Exception | None = None) -> None:
    """The journal takes nothing, as on a full disk, or for another `error`."""
    from companion.storage import JournalError

    def full(*_: object) -> None:
        raise error or JournalError("disk full")

    monkeypatch.setattr(rig.journal, "commit", full)
