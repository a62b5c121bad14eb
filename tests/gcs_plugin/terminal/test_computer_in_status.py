"""What an operator reads of the companion's computer."""

from __future__ import annotations

from typing import Any

from companion.link.encode import computer_status
from gcs_plugin.terminal.wording import status_lines


def test_the_status_shows_how_the_companions_computer_does(sky: Any) -> None:
    figures = {"temperature": 84.0, "throttled": True, "cpu": 0.97, "under_voltage": True, "disk_free": 0}
    sky.hear(sky.rover.heartbeat())
    assert not any("computer" in line for line in status_lines(sky.client.rovers[1], 0.0))
    sky.hear(sky.rover.companion.frame(computer_status(figures, 60.0)))
    told = "84 C, SLOWED DOWN: it sees late, its supply's voltage is TOO LOW, its disk is FULL, CPU 97%"
    assert f"  computer {told}" in status_lines(sky.client.rovers[1], 0.0)
    assert f"  computer {told}, said 10 min ago" in status_lines(sky.client.rovers[1], sky.now + 600.0)
    sky.hear(sky.rover.companion.frame(computer_status({}, 60.0)))
    assert "  computer no temperature told" in status_lines(sky.client.rovers[1], 0.0)
