"""Judges what the camera shows while a person stands on a mark, as the daemon judges: `check --zone`.

Frames go the daemon's way: its camera thread, the vision process's worker, and the rule that decides whether
something in the region of interest stops the rover.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np

from anytraverse.assessment import Assessment, Map, Reason
from anytraverse.frame import Image
from anytraverse.light import Light
from anytraverse.memory import Memory
from anytraverse.release import own_version, program_identity
from companion.calls.reason_filter import PASSABLE, ReasonFilter
from companion.cameras import open_camera
from companion.cameras.newest import CameraState, CameraThread, Patience
from companion.config import Config
from companion.config.stopping import Stopping
from companion.daemon.settings.runtime import call_numbers
from companion.desk.check.new_thing import NewThing, find_new_thing
from companion.desk.check.zone_file import Zone, utc_now
from companion.desk.check.zone_match import judged_by
from companion.vision.exposure import exposure_name
from companion.vision.warm_up import load_and_warm_up
from companion.vision.worker import Worker

FRAMES = 10
"""Frames that are judged at a mark, at least."""
LASTS, LONGEST = 2.0, 20.0
"""Seconds at a mark, at least and at most."""
SILENT = 5.0
"""Seconds without a frame after which a mark cannot be measured."""
_WAIT = 0.1


class NotMeasuredError(Exception):
    """A mark could not be measured. The text says why, and what to do."""


@dataclass
class ZoneFrames:
    """Collects the frames of a mark.

    judged: all of them. count: without those with a fault. noticed: of these, with something in the region
    that stops the rover. stood: of those from the `window`-th on, for which the rule said that it stops the
    rover. raised: whether it ever said so. fault, picture: the newest.
    """

    window: int
    judged: int = 0
    count: int = 0
    noticed: int = 0
    stood: int = 0
    raised: bool = False
    fault: str = ""
    reasons: set[str] = field(default_factory=set)
    light: Light | None = None
    picture: Image | None = None
    _strangeness: Map | None = None

    def add(self, seen: Assessment, fault: str, *, stops: bool) -> None:
        """Take in a frame. fault: why it shows nothing, "" where it does. stops: what the rule says now."""
        self.judged += 1
        self.picture = seen.frame.image
        if fault:
            self.fault = fault
            return
        self.count += 1
        self.noticed += bool(seen.reasons & PASSABLE)
        self.raised = self.raised or stops
        self.stood += stops and self.count >= self.window
        self.reasons |= {reason.value for reason in seen.reasons}
        self.light = seen.light or self.light
        if seen.maps is not None:
            before = 0.0 if self._strangeness is None else self._strangeness
            self._strangeness = np.asarray(before + seen.maps.strangeness, np.float32)

    @property
    def stops(self) -> bool:
        """Whether the rover would have been stopped, from the `window`-th frame to the last.

        That is as soon as `judge_stopping` counts on it, and without a pause.
        """
        return self.count >= self.window and self.stood == self.count - self.window + 1

    @property
    def strangeness(self) -> Map | None:
        """The mean of the frames' strangeness, (h, w), None without any."""
        if self._strangeness is None:
            return None
        return np.asarray(self._strangeness / max(1, self.count), np.float32)

    def looked(self) -> dict[str, Any]:
        """Return the attributes of a `ZoneLook` of now."""
        return {
            "at": utc_now(),
            "frames": self.count,
            "noticed_frames": self.noticed,
            "reasons": tuple(sorted(self.reasons)),
            "light": self.light,
        }


class ZoneJudge:
    """Judges the newest frames of the configured camera. step: seconds that a frame takes."""

    def __init__(self, config: Config, memory: Memory | None) -> None:
        """Load the perceiver with the memory of the journal, and open the camera. Raises AnyTraverseError."""
        ready = load_and_warm_up(config, memory)
        self.engine, self.step, self.notices = ready.engine, ready.step, ready.notices
        self._worker = Worker(ready.engine, 0)
        self._numbers = call_numbers(config, ready.engine.settings)
        self._config, self._ground = config, config.ground_camera
        self._period = 1.0 / config.camera.rate
        self._before: Image | None = None
        """The last picture of the mark before."""
        camera = config.camera
        self._camera = CameraThread(
            partial(open_camera, camera.source, config.camera_options),
            patience=Patience(late=config.freshness),
            size=(camera.width, camera.height),
        )

    def close(self) -> None:
        """Release the camera."""
        self._camera.close()

    def watch(self, going: Callable[[], bool] | None = None, longest: float = LONGEST) -> ZoneFrames:
        """Judge frames of now, for `LASTS` s and `FRAMES` frames, or as long as `going` says.

        longest: seconds. Raises NotMeasuredError where the camera is silent, or too few frames can be judged.
        """
        began, found = time.monotonic(), ZoneFrames(self._numbers.window)
        for _ in self._judge_into(found, began, longest):
            enough = (
                time.monotonic() - began >= LASTS and max(found.count, found.judged - found.count) >= FRAMES
            )
            if enough if going is None else not going():
                break
        if 2 * found.count < found.judged:
            raise NotMeasuredError(f"the frames cannot be judged: {found.fault}")
        if found.count < found.window:
            few = f"{found.count} frames in {longest:.0f} s are too few"
            raise NotMeasuredError(f"{few}: see `companion check`, rows frames and perceiver")
        before, self._before = self._before, found.picture
        if before is not None and self._before is not None and np.array_equal(before, self._before):
            raise NotMeasuredError("the picture is the same as at the mark before: the camera is frozen")
        return found

    def _judge_into(self, found: ZoneFrames, began: float, longest: float) -> Iterator[None]:
        """Add the frames captured from `began` on to `found`, by a rule that begins anew.

        Yields after each, and while none comes.
        """
        rule, due, came = ReasonFilter(self._numbers, began), began, began
        while (now := time.monotonic()) - began < longest:
            frame = self._camera.take(_WAIT)
            now = time.monotonic()
            if frame is None or frame.captured_at < began:
                if now - came > SILENT or self._camera.state is CameraState.ENDED:
                    why = self._camera.status.reason or "no new picture comes"
                    raise NotMeasuredError(f"the camera is silent: {why}")
                yield
                continue
            came = now
            if now < due - self._period / 2:
                continue
            due = max(due + self._period, now - self._period)
            judged = self._worker.judge(frame)
            seen, fault = judged.assessment, judged.assessment.finding(Reason.FAULT)
            # The daemon makes bad light a fault after T: no mark must be judged before.
            dim = exposure_name(judged.luma, self.engine.settings.region)
            why = dim if fault is None else fault.figure
            if not why:
                rule.add_frame(seen, time.monotonic(), None)
            found.add(seen, why, stops=rule.shows_passable)
            yield

    def new_thing(self, frames: ZoneFrames, empty: ZoneFrames) -> NewThing | None:
        """Return what the frames show that the empty ground did not. Nothing is judged by it."""
        limits = self.engine.settings.thresholds
        least = limits.roi if limits.tile is None else limits.tile
        return find_new_thing(frames.strangeness, empty.strangeness, least, self._ground)

    def described(self, stopping: Stopping | None) -> Zone:
        """Return a zone without marks: who judges, by which settings. stopping: None: not known."""
        engine, config = self.engine, self._config
        return Zone(
            at=utc_now(),
            program=own_version(),
            identity=program_identity(),
            model=engine.perceiver.model_id,
            words=dict(engine.memory.preferences),
            **judged_by(config, engine.settings),
            stop={
                "speed": None if stopping is None else stopping.speed,
                "needs": None if stopping is None else round(stopping.needs, 2),
            },
            thing="",
            distances=(),
            verdict="",
            marks=(),
            arcs=(),
        )
