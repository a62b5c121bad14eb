"""Reads the vehicles whose regions are exchanged, and lays the region of one before the camera of another."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory

from anytraverse.errors import AnyTraverseError
from anytraverse.ground import GroundCamera, GroundRegion
from anytraverse.resources import resource
from companion.config import Config, ConfigError, load_config
from companion.config.stopping import Stopping, ground_region, judge_stopping
from companion.sim.field.lens import FIELD_OF_VIEW, LensMount

SHIPPED = ("quadruped", "small-rover", "atv")


class VehicleError(AnyTraverseError):
    """Reports a vehicle's file that cannot be used. The text says what to write."""


@dataclass(frozen=True)
class ExchangeVehicle:
    """A vehicle with its own region of interest. Distances are in m from its front."""

    name: str
    config: Config
    stopping: Stopping
    region: GroundRegion

    @property
    def camera(self) -> GroundCamera:
        """Its camera, which is on it whatever the region."""
        return self.region.camera

    @property
    def mount(self) -> LensMount:
        """The same for the simulated lens."""
        return LensMount(self.camera.height, math.radians(self.camera.tilt))

    @property
    def speed(self) -> float:
        """What it drives: `Stopping.driven`, m/s."""
        return self.stopping.driven

    @property
    def still_needs(self) -> float:
        """Metres from where a frame was taken to standstill, where that frame opens the call.

        Votes and window are over then. What follows is the camera's latency, the delay until the autopilot
        has accepted the hold, and the braking distance. Judging takes no time here.
        """
        stopping, config = self.stopping, self.config
        waits = config.camera.latency + config.stopping.delay
        return self.speed * waits + stopping.brakes.way(self.speed) + stopping.overrun

    def looking_at(self, region: GroundRegion) -> GroundRegion:
        """Return another's region before this vehicle's front, in its own camera.

        It begins where this camera sees ground, and ends `RELIABLE` m from this lens at most. Raises
        SettingsError where nothing is left.
        """
        return GroundRegion.in_view(self.camera, region.near, region.far, region.width, region.vehicle)


def read_vehicle(path: Path) -> ExchangeVehicle:
    """Read a vehicle's file, with the simulated camera's view. Raises VehicleError."""
    if not path.is_file():  # the configuration below would name itself, which nobody has written
        raise VehicleError(f"{path}: there is no such file: give a vehicle's, as config/vehicles/atv.toml")
    view = math.degrees(FIELD_OF_VIEW)
    with TemporaryDirectory() as folder:
        main = Path(folder) / "companion.toml"
        # a JSON string is a TOML string too
        main.write_text(
            f"[camera]\nview = {view:g}\n[vehicle]\nfile = {json.dumps(str(path.absolute()))}\n",
            encoding="utf-8",
        )
        try:
            config = load_config(main)
        except ConfigError as error:
            raise VehicleError(f"{path}: {error}") from error
    stopping, region = judge_stopping(config), ground_region(config)
    if isinstance(stopping, str):
        raise VehicleError(f"{path}: {stopping}")
    if region is None:
        raise VehicleError(f"{path}: set [mount] width")
    return ExchangeVehicle(path.stem, config, stopping, region)


def shipped_vehicles() -> list[ExchangeVehicle]:
    """Read the vehicles that ship."""
    return [read_vehicle(Path(str(resource(f"config/vehicles/{name}.toml")))) for name in SHIPPED]
