"""The remote control as the autopilot tells of it; it may repeat the last pulses of a lost transmitter."""

from __future__ import annotations

import math
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from companion.link.heard import Pulses

FAILED_LASTS = 5.0
"""s that a receiver counts as failed without being told so again."""
_UNKNOWN_STRENGTH = 255
_CHANNELS = 18


class Receiver:
    """Tells pulses from repeated ones as far as the autopilot does: by health or strength, where it has them.

    pulses_at, health_at: s, when RC_CHANNELS and SYS_STATUS came last.
    """

    def __init__(self) -> None:
        self.forget()

    def forget(self) -> None:
        """The autopilot may have rebooted."""
        self.pulses_at = self.health_at = self._failed_at = -math.inf
        self._had_strength = False

    def hear_health(self, message: Any, now: float) -> None:
        """SYS_STATUS. One that knows of no receiver in use says nothing about it."""
        self.health_at = now
        used = message.onboard_control_sensors_present & message.onboard_control_sensors_enabled
        failed = used & ~message.onboard_control_sensors_health & mavlink.MAV_SYS_STATUS_SENSOR_RC_RECEIVER
        self._failed_at = now if failed else -math.inf

    def hear_pulses(self, message: Any, now: float) -> Pulses:
        """RC_CHANNELS; without a channel that counts where the transmitter is known to be gone.

        A strength that is always 0 is none that is measured; one that falls to 0 is a loss.
        """
        self.pulses_at = now
        strength = int(message.rssi)
        self._had_strength = self._had_strength or 0 < strength < _UNKNOWN_STRENGTH
        gone = now - self._failed_at <= FAILED_LASTS or (self._had_strength and strength == 0)
        widths = tuple(int(getattr(message, f"chan{number}_raw")) for number in range(1, _CHANNELS + 1))
        return Pulses(widths, 0 if gone else int(message.chancount))
