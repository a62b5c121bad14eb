"""Runs a segmentation network in ONNX."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from anytraverse.errors import BundleError, PerceiverError
from anytraverse.frame import Image
from anytraverse.perception.classes.details import ClassesDetails
from anytraverse.perception.runtime import Runtime, open_session, run_session

Array = NDArray[np.float32]

FEATURES = "features"
"""The name of an optional second output: the features from which the network makes its scores."""

_LONGEST = 360  # places along the longer side of a map
_MOST_VALUES = 1 << 22  # in all maps together
_TOLERANCE = 1e-3


@dataclass(frozen=True, eq=False)
class Segmented:
    """Holds the network's output for a picture.

    values: of the classes, (classes, h, w) in [0, 1]. features: (d, h', w'); None if the network has none.
    """

    values: Array
    features: Array | None

    @cached_property
    def directions(self) -> Array | None:
        """The features of each place as a unit vector, (d, h', w'); 0 where all features are 0."""
        if self.features is None:
            return None
        lengths = np.sqrt(np.einsum("dhw,dhw->hw", self.features, self.features))
        return np.asarray(self.features / np.maximum(lengths, 1e-12), dtype=np.float32)


class Network:
    """Runs one network. Its maps are thinned to at most 360 places on the longer side."""

    def __init__(self, model: Path, details: ClassesDetails, runtime: Runtime) -> None:
        """Raises PerceiverError when the network cannot be loaded, BundleError if `details` do not fit it."""
        self._details = details
        self._session = open_session(model, runtime)
        inputs, outputs = self._session.get_inputs(), [each.name for each in self._session.get_outputs()]
        if len(inputs) != 1 or details.output not in outputs:
            raise BundleError(
                f"{model.name} has {len(inputs)} inputs and the outputs {', '.join(outputs)}; "
                f'expected is one input and the output "{details.output}": make the bundle again'
            )
        self._input = inputs[0].name
        self._outputs = [details.output, *(name for name in outputs if name == FEATURES)]

    @property
    def has_features(self) -> bool:
        """Whether the network gives features beside its scores."""
        return len(self._outputs) == 2

    def __call__(self, picture: Image) -> Segmented:
        """Segment a picture of the network's size. Raises PerceiverError, also for a NaN or infinity."""
        maps = self.raw(picture)
        if not all(_is_finite(each) for each in maps):
            raise PerceiverError("the network's output is not finite")
        scores, *features = maps
        values = _ACTIVATIONS[self._details.activation](_thinned(scores))
        return Segmented(values, _thinned(features[0]) if features else None)

    def warm_up(self, height: int, width: int) -> None:
        """Run once on a grey picture of this size, so that the first frame is not slow. Raises as `raw`."""
        self.raw(np.full((height, width, 3), 128, dtype=np.uint8))

    def raw(self, picture: Image) -> list[Array]:
        """Return the network's scores, (classes, h, w), and its features, (d, h', w'), if it has them.

        Raises PerceiverError, and BundleError when an output has another shape or dtype.
        """
        given = {self._input: self._details.form.tensor(picture)}
        scores, *features = run_session(self._session, given, self._outputs)
        maps = [self._planes(scores, self._details.output, len(self._details.words.classes))]
        return maps + [self._planes(each, FEATURES, None) for each in features]

    def _planes(self, output: NDArray[Any], name: str, count: int | None) -> Array:
        """Return one picture's maps as float32, channels first. count: of channels; None: any number."""
        if output.dtype.kind != "f":
            raise BundleError(
                f'the network\'s output "{name}" holds {output.dtype}, the numbers of classes and not their '
                "scores, so that nothing can be uncertain: export the network without its final argmax"
            )
        if output.ndim != 4 or len(output) != 1 or output.size == 0:
            raise BundleError(
                f'the network\'s output "{name}" has the shape {output.shape}, expected are maps: '
                "(1, channels, height, width) or (1, height, width, channels)"
            )
        # An output's layout may differ from the input's: the number of channels decides where it is known.
        last = self._details.form.layout == "nhwc"
        if count is not None and output.shape[3 if last else 1] != count:
            last = not last
            if output.shape[3 if last else 1] != count:
                raise BundleError(
                    f"there are {count} class names, but the network gives {output.shape[1 if last else 3]} "
                    f'maps (its output "{name}" is {output.shape}): name each class, in their order'
                )
        maps = output[0].transpose(2, 0, 1) if last else output[0]
        return np.asarray(maps, dtype=np.float32)


def _is_finite(maps: Array) -> bool:
    return math.isfinite(float(maps.min())) and math.isfinite(float(maps.max()))


def _thinned(maps: Array) -> Array:
    """Take every n-th place of the maps, so that pooling takes only milliseconds."""
    count, height, width = maps.shape
    step = math.ceil(max(height, width) / _LONGEST)
    while count * height * width / step**2 > _MOST_VALUES:
        step += 1
    start = step // 2
    return np.ascontiguousarray(maps[:, start::step, start::step])


def _softmax(scores: Array) -> Array:
    shares = np.exp(scores - scores.max(axis=0))
    shares /= shares.sum(axis=0)
    return np.asarray(shares, dtype=np.float32)


def _sigmoid(scores: Array) -> Array:
    return np.asarray(1.0 / (1.0 + np.exp(-np.clip(scores, -80.0, 80.0))), dtype=np.float32)


def _unchanged(values: Array) -> Array:
    lowest, highest = float(values.min()), float(values.max())
    if lowest < -_TOLERANCE or highest > 1.0 + _TOLERANCE:
        raise PerceiverError(
            f"the network gives values from {lowest:.3g} to {highest:.3g}, where the bundle promises 0 to 1: "
            "make the bundle again with --activation softmax or sigmoid"
        )
    return np.clip(values, 0.0, 1.0)


_ACTIVATIONS: dict[str, Callable[[Array], Array]] = {
    "softmax": _softmax,
    "probabilities": _unchanged,
    "sigmoid": _sigmoid,
    "none": _unchanged,
}
