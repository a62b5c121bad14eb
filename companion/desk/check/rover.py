"""Holds what the checks share: the configuration, the companion that runs, and what was measured."""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any, NamedTuple

from anytraverse.errors import AnyTraverseError
from anytraverse.judging import Settings
from companion.config import Config
from companion.desk.check.autopilot import AutopilotReadings, ask_first
from companion.desk.check.watching import CameraDelivery, watch
from companion.system.computer import Computer

_SAMPLE = 0.3
"""Seconds over which the load of this computer is measured."""


class Perceives(NamedTuple):
    """Holds the result of loading the perceiver.

    trouble: why it does not run. model: its name. step: seconds for a frame. judging: the settings by which
    it judges frames, None where it does not run. infrared: whether its maps hold for a camera without
    infrared filter.
    """

    trouble: str = ""
    model: str = ""
    step: float = 0.0
    judging: Settings | None = None
    infrared: bool = False


def load_perceiver(config: Config) -> Perceives:
    """Load the perceiver and measure its time for a frame, as the daemon does. Takes seconds."""
    from companion.vision.messages import Model
    from companion.vision.warm_up import load_and_warm_up

    try:
        ready = load_and_warm_up(config, None)
    except AnyTraverseError as error:
        return Perceives(str(error))
    model = Model.of(ready.engine.perceiver)
    return Perceives("", str(model), ready.step, ready.engine.settings, model.infrared)


@dataclass
class CheckedRover:
    """Gives each check what it needs, and measures that when it is first asked for.

    file: the configuration's, "" where it is not known. folder: the state folder. running: what a companion
    that runs says of itself, None without one: it owns camera, journal and link. link: URL of another way to
    the autopilot.
    inside: whether the companion itself asks, in a thread that must not wait for a program.
    """

    config: Config
    file: str
    folder: Path
    running: Mapping[str, Any] | None = None
    link: str | None = None
    inside: bool = False

    @property
    def holds(self) -> bool:
        """Whether the configured policy is hold."""
        return self.config.call.holds

    @property
    def leaves_link(self) -> bool:
        """Whether the autopilot is not asked, since a companion that runs owns the link."""
        return self.running is not None and self.link is None

    def told(self, name: str) -> Mapping[str, Any]:
        """Return a table of what the running companion says, empty without it."""
        found = (self.running or {}).get(name)
        return found if isinstance(found, Mapping) else {}

    @cached_property
    def seen(self) -> CameraDelivery:
        """Open the camera and watch it for some seconds."""
        return watch(self.config)

    @cached_property
    def perceives(self) -> Perceives:
        """Load the perceiver and measure its time for a frame. Takes seconds."""
        return load_perceiver(self.config)

    @cached_property
    def asked(self) -> AutopilotReadings:
        """Ask the autopilot. Takes up to 40 s for each connection."""
        urls = [one.url for one in self.config.link.settings().connections().values()]
        return ask_first(self.config, [self.link] if self.link else urls)

    @cached_property
    def computer(self) -> Mapping[str, Any]:
        """Return the figures of `Computer`: the running companion's, or measured now."""
        if told := self.told("computer"):
            return told
        computer = Computer(self.folder)
        computer.measure()
        if not self.inside:
            time.sleep(_SAMPLE)
            computer.measure()
        return computer.newest
