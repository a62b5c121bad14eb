"""Calibrates a dense bundle on the user's own frames: which score is enough to say that a word is there.

A dense model gives every word some score everywhere, and which scores are high depends on the model and on
the ground. So the scores of absent words are measured: of things that are not on these frames, such as a
piano. The threshold is chosen so that `GROUP` absent words together reach an attention of 0.5 on `CHANCE` of
the places, and the temperature so that one absent word's median attention is `FAINT`. What reaches more is
more than what words get by chance; the rest is unknown.
"""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING

import cv2
import numpy as np
from numpy.typing import NDArray

from anytraverse.bundle.files import replace_text
from anytraverse.bundle.manifest import MANIFEST
from anytraverse.errors import BundleError
from anytraverse.frame import Image
from anytraverse.perception.dense.details import GROUP, ScoreCalibration, as_json

if TYPE_CHECKING:
    from collections.abc import Callable

    from anytraverse.perception.dense.perceiver import Dense

Array = NDArray[np.float32]

FEWEST_FRAMES = 20
CHANCE = 0.05
FAINT = 0.02
LEAST_RATIO = 3.0
"""Words that explain less than this times what absent words explain are warned of."""

_LEAST_CONTRAST = 4.0  # standard deviation of a picture's grey values; a blank picture has less
_LEAST_DIFFERENCE = 1.0  # mean difference of grey values; a still camera's next picture has less
_LEAST_SPREAD = 1e-4  # of scores: float32 and int8 move them by nearly as much
_MOST_PLACES = 256  # of one frame


@dataclass(frozen=True)
class Calibrated:
    """Holds a calibration, and the share of places where one of the `words` has an attention of 0.5."""

    calibration: ScoreCalibration
    explained: float
    words: tuple[str, ...]


def calibrate(
    folder: Path,
    perceiver: Dense,
    frames: Iterable[Image],
    words: Sequence[str],
    say: Callable[[str], None],
) -> Calibrated:
    """Calibrate the bundle in `folder`, and write the result into its manifest.

    Blank frames and repeated ones do not count. Raises BundleError for fewer than 20 others, for a model that
    tells no two absent words apart on them, and when the manifest cannot be written.
    """
    chosen, groups, asked = _Chosen(), [], []
    singles: list[Array] = []
    for frame in frames:
        if not chosen.take(frame):
            continue
        seen = perceiver.encode(frame)
        places = seen.directions.reshape(len(seen.directions), -1)
        absent = scores_of_absent(perceiver.absent, places[:, _spread(places.shape[1])])
        whole = len(absent) // GROUP * GROUP
        groups.append(absent[:whole].reshape(-1, GROUP, absent.shape[1]).max(axis=1).ravel())
        singles.append(absent.ravel())
        asked.append(perceiver.scores(seen, words).max(axis=0).ravel())
    if len(groups) < FEWEST_FRAMES:
        raise BundleError(
            f"only {len(groups)} frames to calibrate on ({chosen.blank} blank and {chosen.repeated} repeated "
            f"ones do not count), at least {FEWEST_FRAMES} are needed: take pictures along a drive, in the "
            "places and the light that the rover will see"
        )
    threshold = float(np.quantile(np.concatenate(groups), 1.0 - CHANCE))
    temperature = (threshold - float(np.median(np.concatenate(singles)))) / math.log(1.0 / FAINT - 1.0)
    if not temperature > _LEAST_SPREAD:
        raise BundleError(
            "on these frames the model gives all words nearly the same score, so that nothing can be told to "
            "be unknown: check that the frames show your terrain, or use another model"
        )
    calibration = ScoreCalibration(round(threshold, 6), round(temperature, 6), len(groups), CHANCE)
    explained = float((np.concatenate(asked) >= calibration.threshold).mean())
    _write(folder, perceiver, calibration)
    say(f"calibrated on {len(groups)} frames: threshold {threshold:.4f}, temperature {temperature:.4f}")
    return Calibrated(calibration, explained, tuple(words))


def scores_of_absent(absent: Array, places: Array) -> Array:
    """Calculate the scores of absent words, (n, places), each as if it were not among the absent words.

    absent: their embeddings, (n, d). places: features of length 1, (d, places).
    """
    cosines = absent @ places
    others = (cosines.sum(axis=0) - cosines) / (len(absent) - 1)
    return np.asarray(cosines - others, dtype=np.float32)


class _Chosen:
    """Chooses frames that show something, each something else than those chosen before it."""

    def __init__(self) -> None:
        self.blank = self.repeated = 0
        self._chosen: list[NDArray[np.float32]] = []

    def take(self, frame: Image) -> bool:
        grey = cv2.resize(frame, (32, 32), interpolation=cv2.INTER_AREA).mean(axis=2, dtype=np.float32)
        if float(grey.std()) < _LEAST_CONTRAST:
            self.blank += 1
            return False
        if any(float(np.abs(grey - other).mean()) < _LEAST_DIFFERENCE for other in self._chosen):
            self.repeated += 1
            return False
        self._chosen.append(grey)
        return True


def _spread(count: int) -> NDArray[np.intp]:
    return np.linspace(0, count - 1, min(count, _MOST_PLACES)).astype(np.intp)


def _write(folder: Path, perceiver: Dense, calibration: ScoreCalibration) -> None:
    """Replace the calibration in the manifest, at once or not at all. Raises BundleError."""
    path = folder / MANIFEST
    try:
        values = json.loads(path.read_bytes())
        values["details"] = as_json(replace(perceiver.details, calibration=calibration))
        text = json.dumps(values, indent=2, ensure_ascii=False, allow_nan=False) + "\n"
        replace_text(path, text, path.stat().st_mode)
    except OSError as error:
        raise BundleError(
            f"the calibration cannot be written to {path} ({error.strerror}): check the bundle as a user who "
            "may write there"
        ) from error
