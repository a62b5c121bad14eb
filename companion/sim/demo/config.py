"""Writes the configuration that a demo runs with to a file, so that a newcomer can read and change it."""

from __future__ import annotations

import json
import math
from pathlib import Path

from companion.sim.field.lens import FIELD_OF_VIEW, HEIGHT, PITCH
from companion.sim.field.rover import Body
from companion.vehicle.brakes import ARDUPILOT, fit

_MARK = "# Written by `companion demo`."
_TEXT = """\
{mark} config/companion.toml explains every setting.
[camera]
source = {camera}
rate = {rate:g}
{view}
[web]
listen = ""
[recording]
{recording}
[vehicle]
file = ""
{stopping}
[link]
url = {link}
{budgets}

[journal]
folder = {state}

[pictures]
keep = 200

[call]
policy = {policy}
{freshness}
{region}
[words]
"grass" = 1.0
"dirt path" = 1.0
"bush" = -1.0
"tree" = -1.0
"sky" = -1.0
"""


_REGION = """\
# At 1.5 m/s the rover needs 5.0 m from seeing a thing to standstill: `companion check` has the figures.
[roi]
left = 0.35
top = 0.46
right = 0.65
bottom = 0.95

[corridor]
bottom = 0.3
top = 0.08
top_row = 0.46
"""
_GUIDE = """\
# With the vehicle's width the region is in metres. Out of AUTO and of GUIDED the script brakes first.
[guide]
radius = {radius:g}
"""
_STOPPING = """
# The simulated rover, as it is.
[mount]
{width}height = {height:g}
tilt = {tilt:g}
front = {front:g}

[stopping]
speed = {speed:g}
time_constant = {time_constant:g}
braking = {braking:g}
delay = {delay:g}
{brake}"""
_BRAKE = """\
hold_by = "brake"
brake_time_constant = 0.81
brake_braking = 1.57
"""
_RADIUS = 1.2
"""m: of the tightest turn that is planned; the simulated rover's own is 0.88."""
TO_THE_AUTOPILOT = 0.1
"""Seconds from an order until the simulated autopilot is in HOLD, over the loopback."""


def written_by_demo(path: Path) -> bool:
    """Whether an earlier demo wrote this configuration, so that it may be overwritten."""
    return path.is_file() and path.read_bytes().startswith(_MARK.encode())


_NETWORK = """\
# A network carries more than a radio, so that the operator gets large pictures.
budget = 0.0
asked_budget = 0.0
pace = 0.01
"""


def write_config(
    out: Path,
    *,
    camera: str,
    link: str,
    policy: str,
    speed: float | None = None,
    network: bool = False,
    rate: float = 10.0,
    freshness: float | None = None,
    guide: bool = False,
    record: bool = False,
) -> Path:
    """Writes companion.toml into `out`, with the state folder beside it, and returns its path.

    speed: of the simulated rover in m/s; None for the user's own camera, whose mount is not known.
    network: the link is no radio. rate: frames/s that are judged. freshness: the limit T in s, None: it
    follows the rate. guide: with all that policy guide needs. record: every frame, into the state folder.
    """
    path = out / "companion.toml"
    values = {"camera": camera, "link": link, "policy": policy, "state": str(out / "state")}
    # A JSON string is a TOML string too: this quotes paths with any characters.
    quoted = {name: json.dumps(value) for name, value in values.items()}
    # The field's frames carry their capture time, so that no latency of the camera has to be added.
    view = "" if speed is None else f"view = {math.degrees(FIELD_OF_VIEW):g}\nlatency = 0\n"
    stopping = "" if speed is None else _of_the_field(speed, guide=guide)
    region = _GUIDE.format(radius=_RADIUS) if guide else _REGION
    path.write_text(
        _TEXT.format(
            mark=_MARK,
            rate=rate,
            freshness="" if freshness is None else f"freshness = {freshness:g}\n",
            recording=f"size = 200\nrate = {rate:g}" if record else "size = 0",
            view=view,
            stopping=stopping,
            region=region,
            budgets=_NETWORK if network else "",
            **quoted,
        ),
        encoding="utf-8",
    )
    return path


def _of_the_field(speed: float, *, guide: bool) -> str:
    body, found = Body(), fit(ARDUPILOT)
    return _STOPPING.format(
        height=HEIGHT,
        tilt=math.degrees(PITCH),
        front=body.radius,
        speed=speed,
        time_constant=found.time_constant,
        braking=found.braking,
        delay=TO_THE_AUTOPILOT,
        width=f"width = {2 * body.radius:g}\n" if guide else "",
        brake=_BRAKE if guide else "",
    )
