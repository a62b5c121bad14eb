"""Pastes things where a rover would drive, and counts those that it would notice."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import cv2
import numpy as np

from anytraverse.frame import Image
from anytraverse.judging import Settings
from anytraverse.perception.builtin.calibration import Calibration, Floats
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
ENOUGH = 0.95
"""Recall of things that a fit must keep, where it was higher before: of 400, surely more than .92.

A network to which all ground is strange notices everything: to keep all of that would allow no fit.
"""
LEAST = 0.02
"""Share of the default ROI that a thing covers, at least: a smaller one need not be noticed."""
_TRIES = 4  # for each thing, until one is large enough


@dataclass(frozen=True, eq=False)
class ThingOutputs:
    """Holds a network's outputs for a frame with one thing, without `features`, and where the thing is.

    where: (h/4, w/4), as the logits. aspect: width / height of the frame.
    """

    outputs: Outputs
    where: Flags
    aspect: float


def pasted(
    folder: Folder, seed: int, cutouts: Sequence[Cutout] = (), parts: int = 1
) -> Iterator[tuple[Image, Flags]]:
    """Paste things, one into each copy of a frame; yield the copy and where the thing is, (h, w).

    A thing's foot is on drivable ground in the default ROI; frames without any there are left out. It covers
    at least `LEAST` of the ROI. Where there are `cutouts` half of the things are of these. parts: of how many
    folders this is one, which share `THINGS`.
    """
    left = -(-THINGS // parts)
    rng = np.random.default_rng([seed, 11])
    bounds = Settings().region.bounds
    chances = []
    for frame in folder.frames:
        ground = np.isin(frame.labels, DRIVABLE) & bounds.mask(*frame.labels.shape)
        if ground.any():
            chances.append((frame, np.argwhere(ground)))
    for index in range(_TRIES * left if chances else 0):
        frame, feet = chances[index % len(chances)]
        row, column = feet[int(rng.integers(len(feet)))]
        cutout = cutouts[int(rng.integers(len(cutouts)))] if cutouts and index // len(chances) % 2 else None
        picture, names = frame.image.copy(), np.zeros_like(frame.labels)
        paste_thing(picture, names, frame.image, rng, cutout, (float(column), float(row)))
        if (names == UNKNOWN)[bounds.mask(*names.shape)].mean() >= LEAST:
            yield picture, names == UNKNOWN
            left -= 1
        if left <= 0:
            return


def seen(
    network: Network, folder: Folder, seed: int, cutouts: Sequence[Cutout] = (), parts: int = 1
) -> list[ThingOutputs]:
    """Run the network on each frame of `pasted`."""
    found = []
    for image, where in pasted(folder, seed, cutouts, parts):
        outputs = network(image)
        rows, columns = outputs.logits.shape[1:]
        small = cv2.resize(where.astype(np.float32), (columns, rows), interpolation=cv2.INTER_AREA)
        whole = np.asarray(small >= min(0.5, float(small.max())), dtype=np.bool_)
        kept = outputs._replace(features=outputs.features[:0])
        found.append(ThingOutputs(kept, whole, image.shape[1] / image.shape[0]))
    return found


def recall(
    things: Sequence[ThingOutputs], calibration: Calibration, share: float = GroundNetwork.DEFAULTS.tile_share
) -> float:
    """Calculate the share of things that a rover would notice; NaN without any.

    It notices a thing when a tile whose middle is on it has a mean uncertainty above the calibration's tile
    threshold, where every known class has a word. share: a tile's side over the ROI's width.
    """
    if not things:
        return math.nan
    return float(np.mean([noticed(thing, calibration, share) for thing in things]))


def noticed(
    thing: ThingOutputs, calibration: Calibration, share: float = GroundNetwork.DEFAULTS.tile_share
) -> bool:
    """Return whether a rover would notice a thing: see `recall`."""
    _, uncertainty = maps(thing.outputs, calibration, thing.where.shape)
    return worst_on(thing, uncertainty, share) > calibration.tile


def worst_on(
    thing: ThingOutputs, uncertainty: Floats, share: float = GroundNetwork.DEFAULTS.tile_share
) -> float:
    """Return the highest mean uncertainty of a tile whose middle is on the thing. uncertainty: (h/4, w/4)."""
    rows, columns = thing.where.shape
    high, wide = tile_size(rows, columns, Settings().region.bounds, thing.aspect, share)
    means = np.asarray(cv2.blur(uncertainty, (wide, high)))
    return float(means[thing.where].max())
