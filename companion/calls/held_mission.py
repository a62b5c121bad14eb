"""Tracks the mission that a hold interrupted: whether it has ended, and what changed in it meanwhile."""

from __future__ import annotations

from dataclasses import dataclass, replace

from companion.calls.mode_monitor import ModeReport
from companion.vehicle.mission import Mission, MissionState


@dataclass(frozen=True)
class HeldMission:
    """The mission that a hold interrupted.

    before: its report as the vehicle stood. now: its newest report in the hold; both None before the first.
    settled: `before` was reported in the hold: the current item may have moved until then by itself.
    ended: it is complete, or its state is not known and its last item was reached; until another item is set.
    """

    before: Mission | None = None
    now: Mission | None = None
    settled: bool = False
    ended: bool = False

    def driving(self, report: ModeReport) -> HeldMission:
        """Take in a report from before the hold was confirmed, or of a resume that is cancelled."""
        if report.mission is None:
            return self
        return HeldMission(before=report.mission, ended=self.ended or report.mission_ended)

    def standing(self, report: ModeReport) -> HeldMission:
        """Take in a report that shows the mode of the hold."""
        mission = report.mission
        if mission is None or not mission.fresh:
            return self
        held = self if self.settled else replace(self, before=mission, settled=True)
        moved = held.before is not None and (
            mission.replaces(held.before) or mission.item != held.before.item
        )
        ended = mission.state is MissionState.COMPLETE or (held.ended and not moved)
        return replace(held, now=mission, ended=ended)

    def rebooted(self) -> HeldMission:
        """Forget the items: the autopilot starts with the first one. What has ended stays ended."""
        return HeldMission(ended=self.ended)

    @property
    def replaced(self) -> bool:
        """Whether there is another mission now than when the vehicle stood."""
        return self.before is not None and self.now is not None and self.now.replaces(self.before)

    @property
    def moved(self) -> bool:
        """Whether another item of the same mission is the current one now."""
        if self.before is None or self.now is None or self.replaced:
            return False
        return self.now.item != self.before.item
