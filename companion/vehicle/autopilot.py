"""The form that every autopilot's table has."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

ModeCommand = tuple[int, int, int]
"""MAV_CMD_DO_SET_MODE's base mode, custom main mode and custom sub mode."""


@dataclass(frozen=True)
class Autopilot:
    """One kind of autopilot. Modes are HEARTBEAT.custom_mode.

    holdable: modes in which it drives by itself; only out of these may the companion hold.
    hold_mode: the mode that holds. command: how a mode is asked for.
    loses_target: modes that stand still after a hold until they are told again where to go.
    streamed: modes that stand only while zero velocity is streamed to them.
    lead: seconds of that stream before such a mode is taken.
    booting: modes that it shows by itself while it boots.
    rest_mode: stands without a stream: what a hold in a streamed mode is left in when the stream must end.
    tells_late: HEARTBEAT shows a change up to a second later; CURRENT_MODE, asked for, tells it sooner.
    overrun: m that hold_mode drives on, beyond the way of braking, before it circles back and stands.
    """

    name: str
    holdable: frozenset[int]
    hold_mode: int
    rest_mode: int
    command: Callable[[int], ModeCommand]
    names: Mapping[int, str] = field(hash=False)
    loses_target: frozenset[int] = frozenset()
    streamed: frozenset[int] = frozenset()
    booting: frozenset[int] = frozenset()
    lead: float = 0.0
    tells_late: bool = False
    overrun: float = 0.0

    @property
    def circles(self) -> bool:
        """hold_mode drives on and turns back before it stands: the operator is told."""
        return self.overrun > 0.0

    def mode_name(self, mode: int) -> str:
        """ "AUTO"; "mode 99" for one that the table does not know."""
        return self.names.get(mode, f"mode {mode}")
