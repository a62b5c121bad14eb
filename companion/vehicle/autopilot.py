"""Defines what the companion must know of a kind of autopilot: `Autopilot`, a table of its modes."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

ModeCommand = tuple[int, int, int]
"""Parameters of MAV_CMD_DO_SET_MODE: base mode, custom main mode, custom sub mode."""


@dataclass(frozen=True)
class Autopilot:
    """Describes one kind of autopilot. Modes are values of HEARTBEAT.custom_mode.

    holdable: modes in which it drives by itself. The companion may hold only out of these.
    mission_modes: those of them that drive a mission. first_item: the number of its first item.
    hold_mode: the mode that holds. command: parameters of MAV_CMD_DO_SET_MODE for a mode.
    names: mode -> its name for people.
    loses_target: modes that forget their target in a hold; the operator must send it again.
    streamed: modes that stand still only while zero-velocity setpoints are streamed to them.
    booting: modes that it shows by itself while it boots.
    by_itself: modes that it also enters by itself, for a fence or a failsafe. Nobody need have set them.
    brake_mode: the mode in which its script brakes out of a mission before it holds, None where it does not.
    rest_mode: a mode that stands still without setpoints. A hold in a streamed mode changes to it when the
    setpoints must end.
    lead: seconds of setpoints that a streamed mode needs before the autopilot accepts it.
    reports_mode_late: HEARTBEAT shows a mode change up to 1 s late; a requested CURRENT_MODE shows it sooner.
    contradicts_itself: it answers a mode command twice, and the two results differ.
    scripted: a script of ours may run on it, which compares the mode before it sets one.
    stops_without_sticks: its own fail-safe can stop it when a MANUAL_CONTROL stream ends.
    overrun: metres that hold_mode drives on, beyond the braking distance, before it turns back and stands.
    """

    name: str
    holdable: frozenset[int]
    hold_mode: int
    rest_mode: int
    command: Callable[[int], ModeCommand]
    names: Mapping[int, str] = field(hash=False)
    mission_modes: frozenset[int] = frozenset()
    brake_mode: int | None = None
    first_item: int = 0
    loses_target: frozenset[int] = frozenset()
    streamed: frozenset[int] = frozenset()
    booting: frozenset[int] = frozenset()
    by_itself: frozenset[int] = frozenset()
    lead: float = 0.0
    reports_mode_late: bool = False
    contradicts_itself: bool = False
    scripted: bool = False
    stops_without_sticks: bool = False
    overrun: float = 0.0

    @property
    def circles(self) -> bool:
        """Whether hold_mode drives on and turns back before it stands. The operator is warned of that."""
        return self.overrun > 0.0

    def mode_name(self, mode: int) -> str:
        """Return a mode's name, e.g. "AUTO", or "mode 99" for a mode that is not in the table."""
        return self.names.get(mode, f"mode {mode}")
