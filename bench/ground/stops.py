"""Tells how much shorter the rover stops where the script brakes, as measured in ArduPilot's simulation."""

from __future__ import annotations

from typing import Any

STOPS = (
    (0.57, 1.10, 0.51),
    (0.84, 1.78, 0.90),
    (0.93, 1.99, 1.01),
    (1.30, 2.77, 1.50),
    (1.46, 3.06, 1.73),
    (2.67, 5.80, 4.23),
)
"""m/s; m from the request to standstill by HOLD, and by the script's brake in GUIDED: means of 5 or 6 each.

Measured in ArduPilot's own simulation (docs/stopping.md): the simulated rover here brakes by its figures.
"""
SLOW, STOP_GOAL = 1.6, 0.55
"""m/s below which the way braked over that by HOLD has a goal, for all stops together."""


def stop_ratios() -> dict[str, Any]:
    """Return the way braked over that by HOLD: of all `STOPS` below `SLOW` together, and by speed."""
    slow = [stop for stop in STOPS if stop[0] < SLOW]
    together = sum(braked for _, _, braked in slow) / sum(held for _, held, _ in slow)
    by_speed = {f"{speed:g}": round(braked / held, 3) for speed, held, braked in STOPS}
    return {"stop_ratio": round(together, 3), "stop_ratios": by_speed}
