"""Runs a perceiver with given words on labelled frames, and measures the time."""

from __future__ import annotations

import hashlib
import time
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from anytraverse.assessment import Finding, Map, Maps
from anytraverse.bundle.manifest import MANIFEST
from anytraverse.errors import PerceiverError, PreferencesError
from anytraverse.evaluation.datasets import LabelledFrame
from anytraverse.findings import make_maps
from anytraverse.judging import Settings
from anytraverse.perception import Features, Perceiver, Prompt, is_independent, is_joint
from anytraverse.preferences import Preferences
from anytraverse.release import program_identity
from anytraverse.synonyms import refuse_contradictions


@dataclass(frozen=True, eq=False)
class TimedMaps:
    """Holds the maps of a frame, at the model's own resolution, and the milliseconds they took."""

    maps: Maps
    milliseconds: float


def maps_identity(name: str, perceiver: Perceiver) -> str:
    """Name all that a perceiver's maps depend on besides frame and words, the program included.

    name: that it was made by. Of a bundle its variant in use counts, and its manifest with the calibration,
    which `model_id` does not name.
    """
    parts = [perceiver.model_id, str(getattr(perceiver, "precision", "")), f"program {program_identity()}"]
    manifest = Path(name.partition(":")[2]) / MANIFEST
    if manifest.is_file():
        parts.append(hashlib.sha256(manifest.read_bytes()).hexdigest()[:16])
    return " ".join(filter(None, parts))


class PerceiverRun:
    """Runs a perceiver with fixed words. It stores nothing from frame to frame."""

    def __init__(self, perceiver: Perceiver, words: Preferences) -> None:
        """Raises PreferencesError without words, for words that contradict each other, and
        (UnknownWordError) for a word that the perceiver cannot ground."""
        if not words:
            raise PreferencesError("no word is asked: give some, e.g. `trail: 1; grass: 1; bush: -1`")
        for word in words:
            perceiver.meaning(word)
        refuse_contradictions(words, perceiver.meaning)
        self.perceiver = perceiver
        self.words = words
        self._prompts = [Prompt(word, drivable=weight > 0) for word, weight in words.items()]
        self._drivable = [prompt for prompt in self._prompts if prompt.drivable]
        self._settings = Settings()

    def look(self, frame: LabelledFrame, features: Features | None = None) -> TimedMaps:
        """Encode, attend and pool. features: of this frame, so that it is not encoded again.

        Raises PerceiverError, also for maps that cannot be used.
        """
        begin = time.perf_counter()
        if features is None:
            features = self.perceiver.encode(frame.image)
        attention = self.perceiver.attend(features, self._prompts)
        alone = None
        if not is_independent(self.perceiver):
            alone = self.perceiver.attend(features, self._drivable)
        weights = list(self.words.values())
        maps = make_maps(attention, weights, self._settings, alone, joint=is_joint(self.perceiver))
        milliseconds = (time.perf_counter() - begin) * 1e3
        if isinstance(maps, Finding):
            raise PerceiverError(f"{frame.name}: {maps.figure}: the perceiver is broken, or its files are")
        return TimedMaps(maps, milliseconds)


def stretched(values: Map, shape: tuple[int, int]) -> Map:
    """Resize a map in [0, 1] to the size of a label image, (height, width): linear, or by area to shrink."""
    shrinks = values.shape[0] > shape[0] and values.shape[1] > shape[1]
    way = cv2.INTER_AREA if shrinks else cv2.INTER_LINEAR
    return np.clip(np.asarray(cv2.resize(values, shape[::-1], interpolation=way), dtype=np.float32), 0.0, 1.0)


def stretched_mask(mask: NDArray[np.bool_], shape: tuple[int, int]) -> NDArray[np.bool_]:
    """Resize a mask to the size of a label image, (height, width), by nearest neighbour."""
    nearest = cv2.resize(mask.astype(np.uint8), shape[::-1], interpolation=cv2.INTER_NEAREST_EXACT)
    return np.asarray(nearest, dtype=np.bool_)
