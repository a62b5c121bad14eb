"""Tells when the companion cannot see, cannot remember or cannot speak, and when it can again."""

from __future__ import annotations

import logging
from collections.abc import Iterable

from anytraverse.assessment import Reason
from companion.calls.machine import OperatorCalls
from companion.cameras.newest import CameraState
from companion.daemon.persistence import Persistence
from companion.link.link import Link
from companion.tasks import Liveness
from companion.telemetry.summary import fault_name
from companion.vehicle import known_autopilot
from companion.vision.client import Vision
from companion.wire import notices, texts
from companion.wire.ids import Policy

log = logging.getLogger(__name__)


class WeakWords:
    """Tells each weak word once when it comes into use, and again only after it was out of use."""

    def __init__(self) -> None:
        self._told: frozenset[str] = frozenset()

    def new(self, weak: Iterable[str], words: Iterable[str]) -> list[str]:
        """The weak ones of the `words` in use that were not told since they came into use."""
        new = [word for word in weak if word not in self._told]
        self._told = (self._told | frozenset(weak)) & frozenset(words)
        return new


ASLEEP = 1.0
"""Seconds between two looks after which we count as having slept."""


class StallDetector:
    """Notices that we slept; then nothing that was heard or waits to be heard is believed.

    A human may have taken over meanwhile: nothing is commanded until the autopilot has told its mode anew,
    which takes a second at most. What operators sent is lost, as on a bad link, and asked for again.
    """

    def __init__(self, link: Link, calls: OperatorCalls, now: float) -> None:
        self._link = link
        self._calls = calls
        self._awake_at = now

    def look(self, now: float) -> None:
        """Before anything is heard, and before anything leaves: whatever may have kept us waiting between."""
        slept, self._awake_at = now - self._awake_at, now
        if slept > ASLEEP:
            log.warning("the companion stood still for %.1f s: busy, stopped or starved", slept)
            self._link.skip(now)
            self._link.forget_mode()
            self._calls.holding.forget(now, slept)


ALERT, ERROR, WARNING, NOTICE = 1, 3, 4, 5
ALONE_AFTER = 10.0
"""Seconds without an autopilot after which the log says what to check."""
AUTOPILOT_SILENT = "autopilot silent, STOP BY HAND"
RECOVERED_AFTER = 2.0
"""Seconds without a fault until it counts as over: one that comes and goes is said once."""


class HealthMonitor:
    """Says what changed, once."""

    def __init__(
        self,
        liveness: Liveness,
        link: Link,
        vision: Vision,
        calls: OperatorCalls,
        persistence: Persistence,
    ) -> None:
        self._liveness = liveness
        self._link = link
        self._vision = vision
        self._calls = calls
        self._persistence = persistence
        self._faulty_at: float | None = None
        self._link_trouble: str | None = None
        self._unremembered = False
        self._alone_since: float | None = None
        self._alone_said = False
        self._autopilot_silent = False
        self._stranger: tuple[int, int] | None = None
        self._unreliable = False

    def silent(self, now: float) -> list[str]:
        """What gives no sign of life, in two or three words each, the most basic first.

        A view is as old as its capture: what is silent is named by the time that the view is too old.
        """
        others = [AUTOPILOT_SILENT] if self._autopilot_silent else []
        if self._vision.trouble:
            return [self._vision.trouble, *others]
        newest = self._calls.reason_filter.newest
        silent = self._liveness.silent(now + (max(0.0, newest.age) if newest is not None else 0.0))
        if "vision" in silent:  # of the camera nothing is known then
            return ["vision hangs", *others]
        names = {CameraState.ENDED: "camera ended", CameraState.FAILED: "camera failed"}
        camera = names.get(self._vision.camera.state, "camera silent")
        return [camera, *others] if "camera" in silent else others

    def reminder(self) -> str:
        """What is repeated while no call and no hold is open, "" for nothing."""
        if self._autopilot_silent:
            return texts.companion_fault(AUTOPILOT_SILENT)
        script = self._calls.holding.script_holds
        return notices.script_holds(*script) if script is not None else ""

    def look(self, now: float) -> None:
        """Take in the signs of life and tell what changed."""
        self._liveness.beat("vision", self._vision.alive_at)
        if self._vision.delivered_at is not None:
            self._liveness.beat("camera", self._vision.delivered_at)
        self._look_at_silence(now)
        self._look_at_faults(now)
        self._look_at_deaths(now)
        self._look_for_autopilot(now)
        self._look_at_autopilot(now)
        if self._link.trouble != self._link_trouble:
            self._link_trouble = self._link.trouble
            log.warning("%s", self._link_trouble or "link is back")
        if self._persistence.failing != self._unremembered:
            self._unremembered = self._persistence.failing
            text = notices.journal_fails() if self._unremembered else notices.journal_works()
            self._link.say(text, WARNING, now)

    def _look_at_deaths(self, now: float) -> None:
        """What dies again and again may see well in between: it does not end a hold by itself."""
        if self._vision.unreliable:
            self._calls.require_go(anew=not self._unreliable)
        if self._vision.unreliable is not self._unreliable:
            self._unreliable = self._vision.unreliable
            if self._unreliable:
                text = notices.vision_unreliable(hold=self._calls.policy is Policy.HOLD)
                log.error("%s", text)
                self._link.say(text, ALERT, now)

    def _look_at_silence(self, now: float) -> None:
        if self._calls.autopilot_silent(now) == self._autopilot_silent:
            return
        self._autopilot_silent = not self._autopilot_silent
        if self._autopilot_silent:
            log.error("fault: autopilot silent: does it run, is its wire to the companion whole?")
        elif not self._calls.holding.silent(now):
            log.info("the autopilot is heard again")
            self._link.say(notices.autopilot_back(), NOTICE, now)

    def _look_for_autopilot(self, now: float) -> None:
        if self._link.vehicle is not None:
            if self._alone_said:
                log.info("an autopilot is heard")
            self._alone_since, self._alone_said = None, False
        elif self._alone_since is None:
            self._alone_since = now
        elif not self._alone_said and now - self._alone_since >= ALONE_AFTER:
            self._alone_said = True
            log.warning(
                "no autopilot heard for %.0f s: check [link] url, and that autopilot or router sends there",
                ALONE_AFTER,
            )

    def _look_at_autopilot(self, now: float) -> None:
        vehicle = self._link.vehicle
        if vehicle is None or known_autopilot(vehicle.autopilot, vehicle.type) is not None:
            self._stranger = None
        elif self._stranger != (vehicle.autopilot, vehicle.type):
            self._stranger = vehicle.autopilot, vehicle.type
            log.warning("MAV_AUTOPILOT %d on MAV_TYPE %d: not known, it is never held", *self._stranger)
            self._link.say(notices.unknown_autopilot(), WARNING, now)

    def _look_at_faults(self, now: float) -> None:
        if Reason.FAULT in self._calls.reason_filter.reasons(now):
            if self._faulty_at is None:
                why = fault_name(self._calls.reason_filter.newest, self.silent(now))
                log.error("fault: %s", ": ".join(filter(None, (why, self._vision.camera.reason))))
                if self._calls.current_id == 0:
                    self._link.say(texts.companion_fault(why), ERROR, now)
            self._faulty_at = now
        elif self._faulty_at is not None and now - self._faulty_at >= RECOVERED_AFTER:
            self._faulty_at = None
            log.info("sees again")
            self._link.say(texts.recovered(), NOTICE, now)
