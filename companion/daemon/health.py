"""Reports when camera, vision, journal, link or autopilot fail, and when they work again."""

from __future__ import annotations

import logging
from collections.abc import Iterable

from companion.calls.faults import Fault
from companion.calls.machine import OperatorCalls
from companion.calls.summary import fault_name
from companion.cameras.newest import CameraState
from companion.daemon.persistence import Persistence
from companion.link.link import Link
from companion.tasks import Liveness
from companion.vehicle import known_autopilot
from companion.vision.client import VisionClient
from companion.vision.infrared import REMEDY
from companion.wire import notices, texts
from companion.wire.ids import ALERT, ERROR, NOTICE, WARNING

log = logging.getLogger(__name__)


class WeakWords:
    """Selects weak words to report: each once when it comes into use, again only after it was out of use."""

    def __init__(self) -> None:
        self._reported: frozenset[str] = frozenset()

    def new(self, weak: Iterable[str], words: Iterable[str]) -> list[str]:
        """Return the weak ones of the `words` in use that were not reported since they came into use."""
        new = [word for word in weak if word not in self._reported]
        self._reported = (self._reported | frozenset(weak)) & frozenset(words)
        return new


STALLED_AFTER = 1.0
"""Seconds between two calls of `check` after which the process counts as having been stalled."""


class StallDetector:
    """Notices that this process was stalled (busy, stopped or suspended), and discards what is outdated then.

    A human may have taken over meanwhile, so that no mode is commanded until the autopilot has sent its mode
    again, which takes a second at most. What operators sent is lost, as on a bad link; they send it again.
    """

    def __init__(self, link: Link, calls: OperatorCalls, now: float) -> None:
        self._link = link
        self._calls = calls
        self._checked_at = now

    def check(self, now: float) -> None:
        """Check for a stall. Called before anything is received, and again before anything is sent."""
        stalled, self._checked_at = now - self._checked_at, now
        if stalled > STALLED_AFTER:
            log.warning(
                "the companion was stalled for %.1f s: check the load of this computer, and whether it slept",
                stalled,
            )
            # What waits to be read, and a mode that waits to be sent, are from before the stall.
            self._link.discard_received(now)
            self._link.modes.cancel()
            self._calls.monitor.forget(now, stalled)


NO_AUTOPILOT_AFTER = 10.0
"""Seconds without an autopilot after which the log says what to check."""
AUTOPILOT_SILENT = "autopilot silent, STOP BY HAND"
RECOVERED_AFTER = 2.0
"""Seconds without a fault after which it counts as over, so that one that comes and goes is reported once."""


class HealthMonitor:
    """Reports each change of the companion's health once, by log and STATUSTEXT."""

    def __init__(
        self,
        liveness: Liveness,
        link: Link,
        vision: VisionClient,
        calls: OperatorCalls,
        persistence: Persistence,
    ) -> None:
        self._liveness = liveness
        self._link = link
        self._vision = vision
        self._calls = calls
        self._persistence = persistence
        self._fault_seen_at: float | None = None
        self._faults_seen: frozenset[Fault] = frozenset()
        self._link_trouble: str | None = None
        self._journal_failing = self._timestamps_failing = False
        self._no_autopilot_since: float | None = None
        self._no_autopilot_logged = False
        self._autopilot_silent = False
        self._unknown_autopilot: tuple[int, int] | None = None
        self._unreliable = False
        self._infrared = False
        self._rate, self._stuck = vision.rate.value, ""

    def silent(self, now: float) -> list[str]:
        """Name the parts that give no sign of life, in two or three words each, the most basic first.

        The newest frame's age is added to each silence: when the frame counts as too old, the part that
        caused it is named at the same moment.
        """
        told = self._calls.reason_filter.faults.told.values()
        others = [*filter(None, told), *([AUTOPILOT_SILENT] if self._autopilot_silent else [])]
        if self._vision.trouble:
            return [self._vision.trouble, *others]
        newest = self._calls.reason_filter.newest
        silent = self._liveness.silent(now + (max(0.0, newest.age) if newest is not None else 0.0))
        # The camera's state comes from vision, and is not known while that is silent.
        if "vision" in silent or ("camera" in silent and self._vision_fell_silent(now)):
            return ["vision hangs", *others]
        names = {CameraState.ENDED: "camera ended", CameraState.FAILED: "camera failed"}
        camera = names.get(self._vision.camera.state, "camera silent")
        return [camera, *others] if "camera" in silent else others

    def _vision_fell_silent(self, now: float) -> bool:
        """Whether vision has been silent for longer than the camera had been when vision spoke last."""
        alive_at, delivered_at = self._vision.watchdog.alive_at, self._vision.delivered_at
        return delivered_at is not None and now - alive_at > alive_at - delivered_at

    def reminder(self) -> str:
        """Return the text to repeat while no call and no hold is open, "" for none."""
        if self._autopilot_silent:
            return texts.companion_fault(AUTOPILOT_SILENT)
        script = self._calls.holding.script_holds
        return notices.script_holds(*script) if script is not None else ""

    def fault(self, now: float) -> str:
        """Say why nothing can be judged, "" while it can."""
        if not self._calls.reason_filter.standing_faults(now):
            return ""
        return ": ".join(filter(None, (self.fault_name(now), self._vision.camera.reason)))

    def fault_name(self, now: float) -> str:
        """Name the fault in two or three words."""
        return fault_name(self._calls.reason_filter.newest, self.silent(now))

    def check(self, now: float) -> None:
        """Collect the signs of life, and report what changed."""
        self._liveness.beat("vision", self._vision.watchdog.alive_at)
        if self._vision.delivered_at is not None:
            self._liveness.beat("camera", self._vision.delivered_at)
        self._check_autopilot_silence(now)
        self._check_faults(now)
        self._check_vision_deaths(now)
        self._check_judging_rate(now)
        self._check_infrared(now)
        self._check_autopilot_present(now)
        self._check_autopilot_kind(now)
        if self._link.trouble != self._link_trouble:
            self._link_trouble = self._link.trouble
            log.warning("%s", self._link_trouble or "link is back")
        if self._persistence.failing != self._journal_failing:
            self._journal_failing = self._persistence.failing
            text = notices.journal_fails() if self._journal_failing else notices.journal_works()
            self._link.texts.send(text, WARNING, now)
        if self._link.stores_timestamps is self._timestamps_failing:
            self._timestamps_failing = not self._timestamps_failing
            text = notices.timestamps_fail() if self._timestamps_failing else notices.timestamps_work()
            self._link.texts.send(text, WARNING, now)

    def _check_vision_deaths(self, now: float) -> None:
        """Require a go for the present hold while vision is unreliable, and report when it becomes so.

        A process that dies again and again may judge some frames well in between. They must not end a hold.
        """
        if self._vision.watchdog.unreliable:
            self._calls.holding.require_go(anew=not self._unreliable)
        if self._vision.watchdog.unreliable is not self._unreliable:
            self._unreliable = self._vision.watchdog.unreliable
            if self._unreliable:
                text = notices.vision_unreliable(hold=self._calls.policy.holds)
                log.error("%s", text)
                self._link.texts.send(text, ALERT, now)

    def _check_judging_rate(self, now: float) -> None:
        rate, before = self._vision.rate, self._rate
        if bool(rate.stuck) != bool(self._stuck):
            self._stuck = rate.stuck
            if rate.stuck:
                log.warning("%s", text := notices.no_lower_rate(rate.stuck))
                self._link.texts.send(text, WARNING, now)
        if rate.value == before:
            return
        self._rate, lower = rate.value, rate.value < before
        text = notices.judging_rate(rate.value, rate.steps[0], rate.why if lower else "")
        log.log(logging.WARNING if lower else logging.INFO, "%s", text)
        self._link.texts.send(text, WARNING if lower else NOTICE, now)

    def _check_infrared(self, now: float) -> None:
        if (self._vision.infrared is True) is self._infrared:
            return
        self._infrared = not self._infrared
        misled = self._vision.misled_by_infrared
        text = notices.infrared(handled=not misled) if self._infrared else notices.infrared_over()
        log.warning("%s", REMEDY if misled else text)
        self._link.texts.send(text, WARNING if misled else NOTICE, now)

    def _check_autopilot_silence(self, now: float) -> None:
        if self._calls.autopilot_silent(now) == self._autopilot_silent:
            return
        self._autopilot_silent = not self._autopilot_silent
        if self._autopilot_silent:
            log.error("fault: autopilot silent: check its power and its wire to the companion")
        elif not self._calls.monitor.heartbeat_lost(now):
            log.info("the autopilot is heard again")
            self._link.texts.send(notices.autopilot_back(), NOTICE, now)

    def _check_autopilot_present(self, now: float) -> None:
        if self._link.vehicle is not None:
            if self._no_autopilot_logged:
                log.info("an autopilot is heard")
            self._no_autopilot_since, self._no_autopilot_logged = None, False
        elif self._no_autopilot_since is None:
            self._no_autopilot_since = now
        elif not self._no_autopilot_logged and now - self._no_autopilot_since >= NO_AUTOPILOT_AFTER:
            self._no_autopilot_logged = True
            log.warning(
                "no autopilot heard for %.0f s: check [link] url, and that autopilot or router sends there",
                NO_AUTOPILOT_AFTER,
            )

    def _check_autopilot_kind(self, now: float) -> None:
        vehicle = self._link.vehicle
        if vehicle is None or known_autopilot(vehicle.autopilot, vehicle.type) is not None:
            self._unknown_autopilot = None
        elif self._unknown_autopilot != (vehicle.autopilot, vehicle.type):
            self._unknown_autopilot = vehicle.autopilot, vehicle.type
            log.warning(
                "MAV_AUTOPILOT %d on MAV_TYPE %d is not supported: it is never held", *self._unknown_autopilot
            )
            self._link.texts.send(notices.unknown_autopilot(), WARNING, now)

    def _check_faults(self, now: float) -> None:
        standing = self._calls.reason_filter.standing_faults(now)
        if standing:
            self._faults_seen |= standing
            if self._fault_seen_at is None:
                log.error("fault: %s", self.fault(now))
                if self._calls.current_id == 0:
                    self._link.texts.send(texts.companion_fault(self.fault_name(now)), ERROR, now)
            self._fault_seen_at = now
        elif self._fault_seen_at is not None and now - self._fault_seen_at >= RECOVERED_AFTER:
            seen, self._faults_seen, self._fault_seen_at = self._faults_seen, frozenset(), None
            log.info("the fault is over")
            self._link.texts.send(texts.recovered(view=Fault.VIEW in seen), NOTICE, now)
