"""Watches what the autopilot reports: mode, heartbeats, holds by its script, a mission that is held."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

from companion.calls.numbers import Numbers
from companion.vehicle import Autopilot
from companion.vehicle.ardupilot import ScriptHold
from companion.vehicle.state import Mission, MissionState


@dataclass(frozen=True)
class ModeReport:
    """What the autopilot reported.

    mode: custom_mode, None before the first heartbeat. travelled: metres driven, None where not known.
    reported_at: when the newest HEARTBEAT came, monotonic s; None: what was reported counts no more.
    autopilot: its table, None for a kind that is never commanded.
    round_trip: seconds from a command to its acknowledgement.
    compares: its script compares the mode before it sets one, and so overrides no human.
    takes_resume: a resume would be sent to it now.
    reboots: how often it rebooted, as far as its clock shows it.
    mission: its newest report, None before the first. stands: the vehicle is known to stand.
    brake: seconds for which its script may brake before it holds, 0: it holds at once.
    """

    mode: int | None = None
    armed: bool = False
    travelled: float | None = None
    reported_at: float | None = None
    autopilot: Autopilot | None = None
    round_trip: float = 0.0
    compares: bool = False
    takes_resume: bool = False
    reboots: int = 0
    mission: Mission | None = None
    stands: bool = False
    brake: float = 0.0

    @property
    def booting(self) -> bool:
        """Whether the mode is one that it shows while it boots."""
        return self.autopilot is not None and self.mode in self.autopilot.booting

    @property
    def in_driving_mode(self) -> bool:
        """Whether the vehicle is armed, and in a mode in which the autopilot drives by itself."""
        return self.autopilot is not None and self.armed and self.mode in self.autopilot.holdable

    @property
    def drives_itself(self) -> bool:
        """Whether the autopilot drives, so that a hold overrides no human."""
        return self.in_driving_mode and not self.mission_over

    @property
    def mission_over(self) -> bool:
        """Whether the vehicle stands after a mission that is reported as complete.

        A hold would change nothing then, and the resume after it would begin the mission anew.
        """
        complete = self.mission is not None and self.mission.state is MissionState.COMPLETE
        return complete and self.mission_ended and self.stands

    @property
    def mission_ended(self) -> bool:
        """Whether its mission is complete, or has no known state and its last item was reached."""
        mission, autopilot = self.mission, self.autopilot
        if mission is None or autopilot is None or self.mode not in autopilot.mission_modes:
            return False
        if mission.state is MissionState.UNKNOWN:
            return mission.at_last(autopilot.first_item)
        return mission.fresh and mission.state is MissionState.COMPLETE

    def mode_name(self, mode: int) -> str:
        """Return the name of a mode of this autopilot, e.g. "AUTO"."""
        return f"mode {mode}" if self.autopilot is None else self.autopilot.mode_name(mode)

    @property
    def at_rest(self) -> bool:
        """Whether the vehicle is armed, and in the mode that stands still without setpoints."""
        return self.armed and self.autopilot is not None and self.mode == self.autopilot.rest_mode


@dataclass(frozen=True)
class ModeAnswer:
    """The answer to a mode command, by the autopilot or its script.

    mode: the custom_mode that was commanded. by_hand: refused, since a human has set the mode that stands.
    brakes_out_of: the mode out of which the script brakes now, before it holds; None where it does not.
    """

    mode: int
    accepted: bool
    by_hand: bool = False
    brakes_out_of: int | None = None


class ModeMonitor:
    """Keeps the newest report, and decides how long it counts.

    newest: that report. shows_reboot: it shows that the autopilot rebooted since the report before.
    guided_out_of: the mode out of which we have taken the vehicle to drive it round something, None: not.
    """

    def __init__(self, numbers: Numbers) -> None:
        self._numbers = numbers
        self.newest = ModeReport()
        self.shows_reboot = False
        self.guided_out_of: int | None = None
        self._script_hold: ScriptHold | None = None
        self._unknown_until = self._back_at = -math.inf
        self._rebooted = False
        self._heartbeat_at: float | None = None
        self._heartbeat_mode: int | None = None

    def restore(self, mode: int | None) -> None:
        """Take the mode from before a restart. It counts only once the autopilot reports its mode again."""
        self.newest = ModeReport(mode)

    def reported(self, report: ModeReport) -> ModeReport | None:
        """Take in a report. Returns the report before it, None where this one tells nothing new of the mode.

        One with the mode, arming and `reported_at` of the report before has a new position at most.
        """
        self._take_heartbeat(report.reported_at)
        # Sent before the companion hung, and read only after it: the mode may have changed since.
        if report.reported_at is not None and report.reported_at <= self._unknown_until:
            report = replace(report, reported_at=None)
        before, self.newest = self.newest, report
        self._watch_for_a_reboot(before)
        if report.reported_at is None or report.reported_at != before.reported_at:
            self._heartbeat_mode = report.mode
        same = (report.reported_at, report.mode, report.armed) == (
            before.reported_at,
            before.mode,
            before.armed,
        )
        if same and not self.shows_reboot:
            return None
        if not report.at_rest:
            self._script_hold = None
        return before

    def script_hold_reported(self, script_hold: ScriptHold) -> None:
        """Take in that the autopilot's script holds. It counts until the vehicle shows that it is over."""
        self._script_hold = script_hold

    @property
    def script_hold(self) -> ScriptHold | None:
        """The reported hold by the autopilot's script, None where the vehicle does not stand in it."""
        return self._script_hold if self.newest.at_rest else None

    def silent_since(self, before: ModeReport) -> bool:
        """Whether there was a silence after the report `before`, in which the autopilot may have rebooted."""
        reported_at = self.newest.reported_at
        if reported_at is None or before.reported_at is None:
            return True
        return reported_at - before.reported_at > self._numbers.heartbeat_lost

    def forget(self, now: float, slept: float = 0.0) -> None:
        """Treat the mode as unknown until the next report. slept: seconds in which the companion hung.

        The autopilot was not silent in that time, so it does not count as lost heartbeats.
        """
        self._unknown_until = now
        if self._heartbeat_at is not None:
            self._heartbeat_at += slept
        self.newest = replace(self.newest, reported_at=None)

    def known(self, now: float) -> bool:
        """Whether the mode is known: it was reported within `vehicle_silence`."""
        reported_at = self.newest.reported_at
        return reported_at is not None and now - reported_at <= self._numbers.vehicle_silence

    def drives_itself(self, now: float) -> bool:
        """Whether the mode is known, and is one in which the autopilot drives by itself."""
        return self.known(now) and self.newest.drives_itself

    def forget_reboot(self) -> None:
        """Treat the mode as set by somebody, who knows how the vehicle drives."""
        self._rebooted = False

    def drives_unasked(self, now: float) -> bool:
        """Whether it rebooted and drives by itself since, in a mode that nobody has set."""
        return self._rebooted and self.drives_itself(now)

    def heartbeat_lost(self, now: float) -> bool:
        """Whether the autopilot's heartbeats have stopped, or came back less than `heartbeat_back` ago.

        False before the first heartbeat.
        """
        if self._heartbeat_at is None:
            return False
        lost = now - self._heartbeat_at > self._numbers.heartbeat_lost
        return lost or now - self._back_at < self._numbers.heartbeat_back

    def _watch_for_a_reboot(self, before: ModeReport) -> None:
        """Detect a reboot, and the mode that somebody sets after it.

        A mode that changes while or as the vehicle is armed was set by somebody, any other one by nobody.
        """
        report = self.newest
        booted = report.booting or report.reboots != before.reboots
        # A short reboot may show only as a silence after which the vehicle is not armed any more.
        reset = not report.armed and (before.armed or report.mode != before.mode)
        reset = reset and self.silent_since(before)
        self.shows_reboot = booted or reset
        # Where the companion did not listen, somebody may have disarmed the vehicle meanwhile.
        heard = before.reported_at is not None and report.reported_at is not None
        if booted or (reset and heard):
            self._rebooted = True
            return
        # PX4 tells a new mode sooner than the heartbeat that tells whether the vehicle is armed.
        changed = report.mode != self._heartbeat_mode and not before.booting
        if report.armed and (changed or not report.drives_itself):
            self._rebooted = False

    def _take_heartbeat(self, at: float | None) -> None:
        if at is None or (self._heartbeat_at is not None and at <= self._heartbeat_at):
            return
        if self._heartbeat_at is not None and at - self._heartbeat_at > self._numbers.heartbeat_lost:
            self._back_at = at  # heartbeats are back: `heartbeat_lost` waits until they last
        self._heartbeat_at = at


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
