"""Pastes things where a rover would drive, and counts those that it would notice."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace

import cv2
import numpy as np

from anytraverse.frame import Image
from anytraverse.judging import Settings
from anytraverse.perception import DefaultThresholds
from anytraverse.perception.builtin.calibration import Calibration
from anytraverse.perception.builtin.network import Outputs
from anytraverse.perception.builtin.perceiver import GroundNetwork
from anytraverse.roi import tile_size
from anytraverse.training.classes import DRIVABLE, UNKNOWN
from anytraverse.training.cutouts import Cutout
from anytraverse.training.folders import Folder
from anytraverse.training.scores import Flags, Network, maps
from anytraverse.training.unknowns import paste_thing

THINGS = 400
"""Count of things by which a recall is measured, at least: with 20, one thing would be 5 %."""
ENOUGH = 0.9
"""Recall of things that a fit must keep, where it was higher before.

A network to which all ground is strange notices everything: to keep all of that would allow no fit.
"""
_LOWEST = 1 / 16  # factor of the limits
_HALVINGS = 6  # so that the factor is found to 4 %


@dataclass(frozen=True, eq=False)
class Seen:
    """Holds a network's outputs for a frame with one thing, without `features`, and where the thing is.

    where: (h/4, w/4), as the logits. aspect: width / height of the frame.
    """

    outputs: Outputs
    where: Flags
    aspect: float


def pasted(folder: Folder, seed: int, cutouts: Sequence[Cutout] = ()) -> Iterator[tuple[Image, Flags]]:
    """Paste `THINGS` things, one into each copy of a frame; yield the copy and where the thing is, (h, w).

    A thing's foot is on drivable ground in the default ROI; frames without any there are left out. Where
    there are `cutouts` half of the things are of these.
    """
    rng = np.random.default_rng([seed, 11])
    bounds = Settings().region.bounds
    chances = []
    for frame in folder.frames:
        ground = np.isin(frame.labels, DRIVABLE) & bounds.mask(*frame.labels.shape)
        if ground.any():
            chances.append((frame, np.argwhere(ground)))
    for index in range(THINGS if chances else 0):
        frame, feet = chances[index % len(chances)]
        row, column = feet[int(rng.integers(len(feet)))]
        cutout = cutouts[int(rng.integers(len(cutouts)))] if cutouts and index // len(chances) % 2 else None
        picture, names = frame.image.copy(), np.zeros_like(frame.labels)
        paste_thing(picture, names, frame.image, rng, cutout, (float(column), float(row)))
        if (names == UNKNOWN).any():
            yield picture, names == UNKNOWN


def seen(network: Network, folder: Folder, seed: int, cutouts: Sequence[Cutout] = ()) -> list[Seen]:
    """Run the network on each frame of `pasted`."""
    found = []
    for image, where in pasted(folder, seed, cutouts):
        outputs = network(image)
        rows, columns = outputs.logits.shape[1:]
        small = cv2.resize(where.astype(np.float32), (columns, rows), interpolation=cv2.INTER_AREA)
        whole = np.asarray(small >= min(0.5, float(small.max())), dtype=np.bool_)
        kept = outputs._replace(features=outputs.features[:0])
        found.append(Seen(kept, whole, image.shape[1] / image.shape[0]))
    return found


def recall(
    things: Sequence[Seen], calibration: Calibration, thresholds: DefaultThresholds = GroundNetwork.DEFAULTS
) -> float:
    """Calculate the share of things that a rover would notice; NaN without any.

    It notices a thing when a tile whose middle is on it has a mean uncertainty above the tile threshold,
    where every known class has a word.
    """
    if not things:
        return math.nan
    return float(np.mean([noticed(thing, calibration, thresholds) for thing in things]))


def noticed(thing: Seen, calibration: Calibration, thresholds: DefaultThresholds) -> bool:
    """Return whether a rover would notice a thing: see `recall`."""
    rows, columns = thing.where.shape
    _, uncertainty = maps(thing.outputs, calibration, (rows, columns))
    bounds = Settings().region.bounds
    high, wide = tile_size(rows, columns, bounds, thing.aspect, thresholds.tile_share)
    means = np.asarray(cv2.blur(uncertainty, (wide, high)))
    return bool(means[thing.where].max() > (thresholds.tile or thresholds.roi))


def bounded(things: Sequence[Seen], calibration: Calibration, required: float) -> Calibration:
    """Lower both limits of strangeness by one factor, until a rover notices `required` of these things.

    Nothing changes where it notices as many already.
    """
    low, high = _LOWEST, 1.0
    if not things or recall(things, calibration) >= required:
        return calibration
    for _ in range(_HALVINGS):
        middle = (low * high) ** 0.5
        if recall(things, _lowered(calibration, middle)) >= required:
            low = middle
        else:
            high = middle
    return _lowered(calibration, low)


def _lowered(calibration: Calibration, factor: float) -> Calibration:
    return replace(calibration, limits=np.asarray(calibration.limits * factor, dtype=np.float32))
