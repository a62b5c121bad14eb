"""Holds the numbers that a training writes beside the built-in network."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import numpy as np
from numpy.typing import NDArray

from anytraverse.errors import PerceiverError

Floats = NDArray[np.float32]


@dataclass(frozen=True, eq=False)
class Calibration:
    """Holds the numbers beside a network of C classes, D features and M channels at strides 8 and 16.

    classes: their names, in the order of the logits. bias (C,): added to the logits.
    distance_mean (M,), distance_whitening (M, M), distance_centres (K, M): see `distance`. limits (2,) and
    slope: see `strangeness`. tile: the threshold of a tile's uncertainty, (0, 1], that was fitted together
    with bias and limits. tap_mean (T,), tap_whitening (T, T): statistics of the background; see taps.py.
    scene_mean (P,), scene_projection (S, P), scene_threshold: see scene.py. scene_match (n, 2): numbers of
    remembered scenes, and the cosine from which a frame matches one of so many. surroundings_mean (Q,),
    surroundings_whitening (Q, Q): see `surroundings_vector`.
    """

    classes: tuple[str, ...]
    bias: Floats
    distance_mean: Floats
    distance_whitening: Floats
    distance_centres: Floats
    limits: Floats
    slope: float
    tile: float
    tap_mean: Floats
    tap_whitening: Floats
    scene_mean: Floats
    scene_projection: Floats
    scene_threshold: float
    scene_match: Floats
    surroundings_mean: Floats
    surroundings_whitening: Floats

    def save(self, path: Path) -> None:
        """Write the numbers as .npz. Raises OSError."""
        values: dict[str, Any] = {field.name: np.asarray(getattr(self, field.name)) for field in fields(self)}
        with path.open("wb") as file:
            np.savez_compressed(file, **values)

    @classmethod
    def load(cls, path: Path) -> Calibration:
        """Read the numbers back. Raises PerceiverError when the file is missing, damaged or not finite."""
        try:
            with np.load(path, allow_pickle=False) as stored:
                values: dict[str, Any] = {field.name: stored[field.name] for field in fields(cls)}
        except KeyError as error:
            raise PerceiverError(
                f"the calibration {path.name} has no {error}: an older version wrote it, fit it again"
            ) from error
        except (OSError, ValueError, BadZipFile) as error:
            raise PerceiverError(
                f"the calibration {path.name} cannot be read ({error}): install it again"
            ) from error
        numbers = {name: value for name, value in values.items() if name != "classes"}
        if not all(np.isfinite(value).all() for value in numbers.values()):
            raise PerceiverError(f"the calibration {path.name} is not finite: fit it again")
        for name, value in numbers.items():
            values[name] = float(value) if value.ndim == 0 else value.astype(np.float32)
        return cls(**values | {"classes": tuple(str(name) for name in values["classes"])})
