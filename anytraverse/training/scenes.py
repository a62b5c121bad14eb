"""Fits the scene embedding and its threshold, and the whitening of the surroundings.

The embedding's projection keeps revisits together and drives apart. Method: within-class covariance
normalisation (Hatch et al., 2006) and linear discriminant analysis.
"""

from __future__ import annotations

from dataclasses import replace

import cv2
import numpy as np
from numpy.typing import NDArray

from anytraverse.evaluation.scene_matching import Places, fitted_match
from anytraverse.frame import Image
from anytraverse.history import Entry, History
from anytraverse.perception.builtin.calibration import Calibration, Floats
from anytraverse.perception.builtin.scene import (
    SAME_PLACE,
    scene_summary,
    scene_vector,
    surroundings_summary,
)
from anytraverse.preferences import Preferences
from anytraverse.training.folders import BLOCK, Folder
from anytraverse.training.scores import Network, auroc

SIZE = 32
_VISITS = 3  # changed views of each frame
_RIDGE = 0.1  # share of the total variance added to the diagonal of the covariance within places
_RENDERED_WEIGHT = 4.0  # weight of rendered frames: driving on changes a frame more than another light does
_FLATTENING = 0.35  # 0: directions count by how well they tell places apart; 0.5: all count equally
_RATES = {1: 0.2, 4: 0.2, 16: 0.2, 40: 0.2, 64: 0.2, 256: 0.4}
"""Number of remembered scenes -> share of frames of other drives that may match any of them.

These drives are of the same vehicle and region, and partly of the same tracks. Frames of other regions match
far more rarely: docs/builtin.md has the figures.
"""
_OTHERS = 0.15  # share of pairs of different drives that may count as the same place
_REVISITS = 0.97  # least share of revisits that count as the same place; it goes before `_OTHERS`


FAMILIAR = 0.85
"""Share of a left-out drive's frames that are familiar to a rover that knows the other drives."""
_KNOWN_EVERY = 20  # frames of these, of which one is remembered
_ISOTROPIC = 1.0
"""Share of the mean variance that is added to each direction: which camera it was must not count much."""


def revisited(image: Image, rng: np.random.Generator) -> Image:
    """Change a frame as it may look on another day: shifted and turned a little, in another light."""
    rows, columns = image.shape[:2]
    share = rng.uniform(0.88, 1.0)
    left, top = rng.uniform(0, 1 - share) * columns, rng.uniform(0, 1 - share) * rows
    matrix = cv2.getRotationMatrix2D((columns / 2, rows / 2), float(rng.uniform(-2, 2)), 1 / share)
    matrix[:, 2] -= ((left - (1 - share) / 2 * columns) / share, (top - (1 - share) / 2 * rows) / share)
    moved = cv2.warpAffine(image, matrix, (columns, rows), borderMode=cv2.BORDER_REFLECT)
    warmth = rng.normal(0, 0.06)
    gains = np.exp(np.clip(rng.normal(0, 0.3), -0.7, 0.5) + np.array([warmth, 0, -warmth]))
    return np.asarray(np.clip(moved * gains, 0, 255), dtype=np.uint8)


def fitted_scene(
    network: Network, filmed: Folder, made: Folder, validation: Folder, start: Calibration, seed: int = 0
) -> Calibration:
    """Fit the projection to `filmed` and `made` (rendered) frames, and the threshold to `validation`.

    A place is a filmed frame with its changed views, or a block of rendered frames.
    """
    rng = np.random.default_rng([seed, 5])
    visits = _visits(network, filmed, rng)
    middles = visits.mean(axis=1)
    within = (visits - middles[:, None]).reshape(-1, visits.shape[-1]) * np.sqrt(_VISITS / (_VISITS - 1))
    everything = [middles]
    if len(made) > SIZE:
        passes = np.stack([scene_summary(network(frame.image)) for frame in made.frames])
        within = np.concatenate([within, _RENDERED_WEIGHT * _deviations(passes, made)])
        everything.append(passes)
    total = np.concatenate(everything)
    mean, spread = total.mean(axis=0), total.std(axis=0) + 1e-4
    projection = _discriminant(within / spread, (total - mean) / spread) / spread
    fitted = replace(
        start,
        scene_mean=mean.astype(np.float32),
        scene_projection=projection.astype(np.float32),
        scene_threshold=0.5,
    )
    same, other = cosines(network, validation, filmed, fitted, rng)
    fitted = replace(fitted, scene_threshold=_threshold(same, other))
    return replace(fitted, scene_match=_fitted_match(network, filmed, validation, fitted, rng))


def cosines(
    network: Network, folder: Folder, others: Folder, calibration: Calibration, rng: np.random.Generator
) -> tuple[Floats, Floats]:
    """Return the cosines of a folder's frames with their revisits, and with frames of other blocks.

    Every fourth frame of `others` is among the latter. The cosines are those before the constant entry.
    """
    plain = replace(calibration, scene_threshold=SAME_PLACE)
    first = np.stack([scene_vector(network(f.image), plain) for f in folder.frames])
    again = np.stack([scene_vector(network(revisited(f.image, rng)), plain) for f in folder.frames])
    elsewhere = [scene_vector(network(f.image), plain) for f in others.frames[::4]]
    blocks = np.array([f.number // BLOCK for f in (*folder.frames, *others.frames[::4])])
    every = first @ np.stack([*again, *elsewhere]).T
    apart = blocks[: len(first), None] != blocks[None]
    if not apart.any():
        apart = np.eye(*every.shape) == 0
    return np.asarray(np.diag(every), dtype=np.float32), np.asarray(every[apart], dtype=np.float32)


def _fitted_match(
    network: Network, filmed: Folder, validation: Folder, fitted: Calibration, rng: np.random.Generator
) -> Floats:
    """Fit the cosine of a match for each number of remembered scenes, (n, 2): see `scene_matching`.

    Remembered are frames of `filmed`; foreign are those of `validation`, which are of other drives.
    """
    remembered = np.stack([scene_vector(network(f.image), fitted) for f in filmed.frames])
    again = np.stack([scene_vector(network(revisited(f.image, rng)), fitted) for f in filmed.frames])
    foreign = np.stack([scene_vector(network(f.image), fitted) for f in validation.frames])
    rates = {number: rate for number, rate in _RATES.items() if number <= len(remembered)}
    places = Places(remembered, again, np.arange(len(again)), foreign)
    return np.array(fitted_match(places, rates), dtype=np.float32).reshape(-1, 2)


def fitted_surroundings(network: Network, filmed: Folder, start: Calibration) -> Calibration:
    """Fit the whitening to how frames of one drive vary, and its scale to drives that were left out.

    A rover is at home in a region, not in one place: so frames of all drives of one region vary alike, and
    those of another region differ in all directions a little.
    """
    seen = np.stack([surroundings_summary(network(frame.image)) for frame in filmed.frames])
    drives = np.array([frame.number // BLOCK for frame in filmed.frames])
    strange = list[float]()
    for drive in np.unique(drives):
        own = drives == drive
        others = ~own if not own.all() else own
        mean, whitening = _whitened_drives(seen[others], drives[others])
        vectors = (seen - mean) @ whitening.T
        known = History([_scene(number, one) for number, one in enumerate(vectors[others][::_KNOWN_EVERY])])
        found = [known.strangeness(vector, Preferences()) for vector in vectors[own]]
        strange += [one for one in found if one is not None]
    mean, whitening = _whitened_drives(seen, drives)
    limit = float(np.quantile(strange, FAMILIAR)) if strange else 1.0
    return replace(
        start,
        surroundings_mean=mean.astype(np.float32),
        surroundings_whitening=(whitening / np.sqrt(max(limit, 1e-6))).astype(np.float32),
    )


def _scene(number: int, vector: NDArray[np.float64]) -> Entry:
    return Entry(
        np.ones(1, np.float32), Preferences(), number, number, surroundings=vector.astype(np.float32)
    )


def _whitened_drives(
    seen: Floats, drives: NDArray[np.int_]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the mean, (n,), and the whitening, (n, n), of how frames differ from their drive's mean."""
    wide = seen.astype(np.float64)
    mean, spread = wide.mean(axis=0), wide.std(axis=0) + 1e-3
    even = (wide - mean) / spread
    apart = np.concatenate(
        [even[drives == one] - even[drives == one].mean(axis=0) for one in np.unique(drives)]
    )
    inner = apart.T @ apart / max(len(apart) - 1, 1)
    inner += _ISOTROPIC * max(float(np.trace(inner)) / len(inner), 1e-6) * np.eye(len(inner))
    values, axes = np.linalg.eigh(inner)
    return mean, (axes * (values * len(values)) ** -0.5) @ axes.T / spread


def scene_auroc(same: Floats, other: Floats) -> float:
    """Calculate the chance that a revisit is more similar than a pair of frames of two drives."""
    return auroc(np.concatenate([same, other]), np.arange(len(same) + len(other)) < len(same))


def _visits(network: Network, folder: Folder, rng: np.random.Generator) -> NDArray[np.float64]:
    """Summarise changed views of each frame, (frames, views, 4 D)."""
    return np.stack(
        [
            np.stack([scene_summary(network(revisited(frame.image, rng))) for _ in range(_VISITS)])
            for frame in folder.frames
        ]
    ).astype(np.float64)


def _deviations(passes: Floats, made: Folder) -> NDArray[np.float64]:
    """Return how the frames of each block differ from the block's mean, (frames, 4 D)."""
    blocks = np.array([frame.number // BLOCK for frame in made.frames])
    every = [passes[blocks == block].astype(np.float64) for block in np.unique(blocks)]
    return np.concatenate(
        [(own - own.mean(axis=0)) * np.sqrt(len(own) / (len(own) - 1)) for own in every if len(own) > 1]
    )


def _discriminant(within: NDArray[np.float64], total: NDArray[np.float64]) -> NDArray[np.float64]:
    """Find the `SIZE` directions in which places differ most, relative to how one place varies, (SIZE, n)."""
    count = total.shape[1]
    inner = within.T @ within / len(within) + _RIDGE * np.eye(count)
    values, axes = np.linalg.eigh(inner)
    whitening = (axes * values**-0.5) @ axes.T
    outer = whitening @ (total.T @ total / len(total)) @ whitening
    spreads, directions = np.linalg.eigh(outer)
    chosen = directions[:, ::-1][:, :SIZE]
    scale = np.maximum(spreads[::-1][:SIZE], 1e-6) ** -_FLATTENING
    return np.asarray((chosen * scale).T @ whitening)


def _threshold(same: Floats, other: Floats) -> float:
    """Choose a threshold that few pairs of other drives exceed; lower where too many revisits would not."""
    return float(np.clip(min(np.quantile(other, 1 - _OTHERS), np.quantile(same, 1 - _REVISITS)), 0.05, 0.9))
