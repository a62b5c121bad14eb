"""Waits until the demo's daemon sees and may hold, at a pace that this computer keeps."""

from __future__ import annotations

import math
import time
from collections.abc import Callable

from companion.sim.demo.pace import PACES, DemoPace, JudgingMeter, pace_for, slower
from companion.sim.demo.stage import DemoStage
from companion.sim.demo.story import Story

READY_WITHIN = 600.0
"""Seconds: on two cores that 35 programs wanted, four minutes went by until the network was loaded."""
SEES_WITHIN, LEAST_SEEN = 40.0, 40
"""Seconds from the first picture, and pictures, within which it must know what it sees."""
SLOW_FOR = 8.0
"""Seconds for which hold must have been refused before the computer counts as too slow for it."""
WAITS = 120.0
"""Seconds for which hold may be refused at the slowest pace."""
STEP = 0.1
_BLIND = (None, "starting", "fault")
_WHY = "cannot be given"


class Readiness:
    """Measures what this computer can do, says it, and has daemon and rover go by it."""

    def __init__(
        self,
        stage: DemoStage,
        story: Story,
        clock: Callable[[], float] = time.monotonic,
        sleep: Callable[[float], None] = time.sleep,
    ) -> None:
        """clock: monotonic s; a test's time is virtual."""
        self._clock, self._sleep = clock, sleep
        self._stage = stage
        self._story = story
        self.meter = JudgingMeter()
        self.refused = ""
        """Why the policy is refused now, as the daemon says; "" where it is not."""
        self._refused_at = math.inf

    def get_ready(self) -> None:
        """Chooses the pace, and waits. Raises ChildError when it sees nothing it knows, or cannot hold."""
        self._story.plain("The field is there; the daemon loads its network.")
        self._story.doing = "the daemon loads its network"
        wanted = self._stage.pace
        if wanted in PACES:  # else somebody else has chosen it
            self._wait(until_measured=True)
            judging = self.meter.settled(self._clock())
            if judging is not None:
                wanted = pace_for(judging, guide=self._stage.setup.guide)
                self._story.plain(
                    _sentence(f"this computer judges {judging}: the rover drives at {self.speed(wanted)}")
                )
        if wanted != self._stage.pace:
            self._stage.change_pace(wanted)
        self.wait_at_pace(driving=False)

    def wait_at_pace(self, *, driving: bool) -> None:
        """Waits until it sees and may hold, at slower paces if need be. driving: calls may be open."""
        while self._wait(driving=driving):
            after, refusal = self.slower(), self.refusal()
            if after is None:
                self._story.plain(_sentence(f"{refusal}. The demo waits until this computer is less busy"))
                self._story.doing = "this computer is too busy"
                if why := self._wait(driving=driving, refused_for=WAITS):
                    raise self._stage.daemon.error(f"cannot hold ({why})")
                return
            self._story.plain(_sentence(f"{refusal}. So the rover drives at {self.speed(after)}"))
            self._stage.change_pace(after)

    def slower(self) -> DemoPace | None:
        """Return the pace to go on at where this one cannot be kept, None after the slowest."""
        return slower(self._stage.pace, self.meter.judging(self._clock()), guide=self._stage.setup.guide)

    def refusal(self) -> str:
        """Says that the policy is refused, and why, with the speed that would do."""
        log = self._stage.daemon.log.read_text(encoding="utf-8", errors="replace").split("\n")
        full = next((line.partition(_WHY)[2].lstrip(": ") for line in reversed(log) if _WHY in line), "")
        name = "guide" if self._stage.setup.guide else "hold"
        why = f"{self.refused}: {full}" if full else self.refused
        return f"policy {name} is refused at {self._stage.speed:g} m/s. {why}"

    def look(self, now: float) -> dict[str, object]:
        """Reads the daemon's status. now: monotonic s."""
        status = self._stage.daemon_status()
        self.meter.take(status, now)
        refused = status.get("guide_refused" if self._stage.setup.guide else "hold_refused", "")
        self.refused = str(refused)
        self._refused_at = min(self._refused_at, now) if refused else math.inf
        return status

    def refused_for(self, seconds: float, now: float) -> bool:
        """Whether the policy is refused for so long: a few slow frames do not count."""
        return now - self._refused_at >= seconds

    def _wait(
        self, *, until_measured: bool = False, driving: bool = False, refused_for: float = SLOW_FOR
    ) -> str:
        """Waits until it is ready. Returns why the policy is refused for so many s, "" where it is not."""
        daemon, deadline = self._stage.daemon, self._clock() + READY_WITHIN
        self._refused_at = math.inf
        while (now := self._clock()) < deadline and daemon.running:
            if not self._stage.operator.running:  # a person has quit
                return ""
            state = self.look(now).get("state")
            if until_measured:
                if self.meter.settled(now) is not None:
                    return ""
            elif self.refused_for(refused_for, now):
                return self.refused
            elif not self.refused and (state not in _BLIND if driving else state == "ok"):
                return ""
            elif not self.refused and self._looked_long(now):
                break
            self._sleep(STEP)
        raise daemon.error("saw nothing that it knows" if self.meter.frames else "judged no picture")

    def _looked_long(self, now: float) -> bool:
        began = self.meter.began
        return began is not None and now - began >= SEES_WITHIN and self.meter.frames >= LEAST_SEEN

    def speed(self, pace: DemoPace) -> str:
        """Says how fast the rover drives at a pace, and what is judged."""
        drives = f"{pace.drives(guide=self._stage.setup.guide):g} m/s"
        return drives if pace is PACES[0] else f"{drives}, and {pace.rate:g} a second will do"


def _sentence(text: str) -> str:
    return f"{text[0].upper()}{text[1:]}."
