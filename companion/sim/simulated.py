"""Says how a companion is configured for the simulated field, and how both are started."""

from __future__ import annotations

import math
import sys
from pathlib import Path

from companion.sim.demo.config import TO_THE_AUTOPILOT
from companion.sim.field.lens import FIELD_OF_VIEW, HEIGHT, PITCH
from companion.sim.field.rover import Body
from companion.vehicle.brakes import ARDUPILOT, fit

PORT = 14750
"""Of the field for which `companion init --simulated` writes: link, ground and frames have three in a row."""
SPEED = 1.5
"""m/s, from which the simulated rover stops in time."""


def simulated_settings() -> dict[str, object]:
    """Return what differs from the shipped configuration, as of `propose`."""
    brakes = fit(ARDUPILOT)
    return {
        "camera.source": f"field:127.0.0.1:{PORT + 2}",
        "camera.rate": 5.0,  # so that a slower computer can do it, too
        "camera.view": round(math.degrees(FIELD_OF_VIEW), 1),
        "camera.latency": 0.0,  # its frames say when they were captured
        "mount.height": HEIGHT,
        "mount.tilt": round(math.degrees(PITCH), 1),
        "mount.front": Body().radius,
        "stopping.speed": SPEED,
        "stopping.time_constant": brakes.time_constant,
        "stopping.braking": brakes.braking,
        "stopping.delay": TO_THE_AUTOPILOT,
        "roi.top": 0.45,
        "call.policy": "hold",
        "link.url": f"udpout:127.0.0.1:{PORT}",
        "journal.folder": "state",
        "recording.size": 100,
    }


def next_steps(file: Path) -> str:
    """Return what to type, each in a terminal of its own. file: the configuration."""
    python, programs = sys.executable, Path(sys.executable).parent
    return f"""\
Type each in a terminal of its own:
  {python} -m companion.sim.field --port {PORT} --speed {SPEED:g} --autostart
  {programs}/companion run --config {file}
  {programs}/anytraverse-operator --connect udpout:127.0.0.1:{PORT + 1}
The rover drives, is held and asks; you answer in the third. http://127.0.0.1:8191/ shows what it sees."""
