"""Parameters and the figures that frames are judged by: one made from the other. Pure."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType
from typing import Any

from anytraverse.errors import RegionError, SettingsError
from anytraverse.judging import Settings
from anytraverse.regions import Box
from companion.wire import parameters
from companion.wire.parameters import NOT_IN_USE, ROI, THR_TILE

SMALLEST_ROI = 0.05
"""Least width and height, fractions of the image's: a smaller one holds too few cells of a map."""
THRESHOLDS: Mapping[str, str] = MappingProxyType(
    {
        parameters.THR_ROI: "roi",
        parameters.THR_SCENE: "scene",
        THR_TILE: "tile",
        parameters.THR_TRAV: "trav",
    }
)
"""Parameter -> field of `Thresholds`."""
OF_THE_PERCEIVER = (parameters.THR_ROI, parameters.THR_SCENE, THR_TILE)
"""What means something only to the perceiver that it was set for."""


def judging_values(judging: Settings) -> dict[str, float]:
    """Parameter name -> value of thresholds and region of interest."""
    bounds = judging.region.bounds
    found = {name: getattr(judging.thresholds, field) for name, field in THRESHOLDS.items()}
    told = {name: NOT_IN_USE if value is None else float(value) for name, value in found.items()}
    return told | {name: getattr(bounds, side) for side, name in ROI.items()}


def tuned(judging: Settings, values: Mapping[str, float]) -> Settings:
    """`judging` with some parameters' values. Raises SettingsError, with what to do in a few words."""
    thresholds: dict[str, Any] = {
        field: None if name == THR_TILE and values[name] == NOT_IN_USE else values[name]
        for name, field in THRESHOLDS.items()
        if name in values
    }
    sides = {side: values[name] for side, name in ROI.items() if name in values}
    return replace(
        judging,
        thresholds=replace(judging.thresholds, **thresholds),
        region=_region(judging.region.bounds, sides) if sides else judging.region,
    )


def _region(bounds: Box, sides: Mapping[str, float]) -> Box:
    box = {side: getattr(bounds, side) for side in ROI} | dict(sides)
    for low, high in (("left", "right"), ("top", "bottom")):
        if box[low] >= box[high]:
            raise SettingsError(f"ROI {low} must be < {high}")
        if box[high] - box[low] < SMALLEST_ROI - 1e-6:
            raise SettingsError(f"ROI {low} to {high} under {SMALLEST_ROI:g}")
    try:
        return Box(**box)
    except RegionError as error:
        raise SettingsError(str(error)) from error
