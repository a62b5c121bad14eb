"""Carries out the requests of the control channel by one table; each is checked before anything changes."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import fields
from typing import Any

from anytraverse.errors import RegionError
from anytraverse.regions import Box
from companion.sim.field.autopilot import HAND
from companion.sim.field.control import FieldError
from companion.sim.field.simulation import Simulation
from companion.sim.field.telemetry import RC_CHANNELS

Request = dict[str, Any]
RATES = 0.2, 60.0  # pictures/s of the camera
MAX_HAND_SECONDS = 60.0
MAX_BOOT_SECONDS = 60.0
FIRST_SWITCH = 5  # the channels below are the sticks


class ControlRequests:
    """Carries out requests on a simulation.

    Its process provides `status`, `look`, `freeze`, `film` (it takes pictures/s) and `stop`.
    """

    def __init__(
        self,
        simulation: Simulation,
        *,
        status: Callable[[], dict[str, Any]],
        look: Callable[[Box, float | None], dict[str, Any]],
        freeze: Callable[[bool], None],
        film: Callable[[float], None],
        stop: Callable[[], None],
    ) -> None:
        self._simulation = simulation
        self._told: dict[str, Callable[[Request], dict[str, Any]]] = {
            "look": lambda request: look(_box(request), _time(request)),
            "status": lambda _: status(),
        }
        self._known: dict[str, Callable[[Request], None]] = {
            "arm": lambda request: self._arm(on=_flag(request, "on")),
            "film": lambda request: film(_number(request, "fps", *RATES)),
            "freeze_camera": lambda request: freeze(_flag(request, "on")),
            "light": lambda request: simulation.light(_number(request, "level", 0.0, 1.0)),
            "mode": self._mode,
            "move": self._move,
            "reboot": lambda request: simulation.autopilot.reboot(
                _number(request, "seconds", 0.0, MAX_BOOT_SECONDS, default=5.0),
                _number(request, "checks", 0.0, MAX_BOOT_SECONDS, default=0.0),
            ),
            "parameter": self._parameter,
            "remove": lambda request: simulation.remove(self._thing(request)),
            "rc": self._rc,
            "start": lambda _: self.start(),
            "stop": lambda _: stop(),
            "throttle": self._throttle,
            "transmitter": self._transmitter,
        }

    def handle(self, request: Request) -> dict[str, Any]:
        """Carries out a request and returns the answer. Raises FieldError that says what is wrong with it."""
        do = request["do"]
        if do in self._told:
            return self._told[do](request)
        if do not in self._known:
            raise FieldError(f"no request {do!r}; there are {', '.join((*self._told, *self._known))}")
        self._known[do](request)
        return {"ok": True}

    def start(self) -> None:
        """Arms the rover and sets the mode that drives the trail, as a pilot does by hand."""
        self._arm(on=True)
        autopilot = self._simulation.autopilot
        autopilot.set_mode(autopilot.mission, HAND)

    def _arm(self, *, on: bool) -> None:
        if not self._simulation.autopilot.arm(on=on):
            raise FieldError("the script on the autopilot forbids arming: it wants a companion (ATS_NEED)")

    def _mode(self, request: Request) -> None:
        name = request.get("mode")
        modes = self._simulation.autopilot.modes.__members__
        if not isinstance(name, str) or name not in modes:
            raise FieldError(f'"mode" is one of {", ".join(modes)}')
        self._simulation.autopilot.set_mode(modes[name], HAND)

    def _move(self, request: Request) -> None:
        thing = self._thing(request)
        self._simulation.move(thing, _number(request, "x", -1e4, 1e4), _number(request, "y", -1e4, 1e4))

    def _parameter(self, request: Request) -> None:
        name, value = str(request.get("name")), _number(request, "value", -1e6, 1e6)
        row = self._simulation.autopilot.set_parameter(name, value)
        if row is None or not math.isclose(row.value, value, rel_tol=1e-6):
            raise FieldError(
                f"{name[:16]} is no parameter of this autopilot, or {value:g} is out of its range"
            )

    def _throttle(self, request: Request) -> None:
        self._simulation.set_sticks(
            _number(request, "throttle", -1.0, 1.0, default=0.0),
            _number(request, "steering", -1.0, 1.0, default=0.0),
            _number(request, "seconds", 0.0, MAX_HAND_SECONDS, default=2.0),
        )

    def _transmitter(self, request: Request) -> None:
        self._simulation.rover.transmitter.on = _flag(request, "on")

    def _rc(self, request: Request) -> None:
        channel = round(_number(request, "channel", FIRST_SWITCH, RC_CHANNELS))
        pulse = round(_number(request, "pwm", 800, 2200))
        self._simulation.rover.transmitter.switches[channel] = pulse

    def _thing(self, request: Request) -> str:
        thing = request.get("id")
        things = self._simulation.world.things
        if not isinstance(thing, str) or thing not in things:
            surprises = sorted(name for name, known in things.items() if known.surprise)
            raise FieldError(f'"id" is the id of a thing, such as {", ".join(surprises[:8])}')
        return thing


def _flag(request: Request, name: str) -> bool:
    value = request.get(name)
    if not isinstance(value, bool):
        raise FieldError(f'"{name}" is true or false')
    return value


def _number(request: Request, name: str, low: float, high: float, *, default: float | None = None) -> float:
    value = request.get(name, default)
    if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
        raise FieldError(f'"{name}" is a number from {low:g} to {high:g}')
    return float(value)


def _box(request: Request) -> Box:
    sides = request.get("box")
    if not isinstance(sides, list) or len(sides) != len(fields(Box)):
        raise FieldError('"box" is left, top, right and bottom, in fractions of the picture')
    try:
        return Box(*(_number({"box": side}, "box", 0.0, 1.0) for side in sides))
    except RegionError as error:
        raise FieldError(str(error)) from error


def _time(request: Request) -> float | None:
    return None if request.get("at") is None else _number(request, "at", 0.0, math.inf)
