"""Finds out the input and the scores of a segmentation network, by reading it and running it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from anytraverse.errors import BundleError
from anytraverse.perception.classes.details import LAYOUTS, ClassesDetails, InputForm
from anytraverse.perception.classes.network import FEATURES, Network
from anytraverse.perception.classes.words import ClassWords
from anytraverse.perception.runtime import Runtime, open_session

_DTYPES = ("tensor(float)", "tensor(uint8)")
_TOLERANCE = 1e-3

Dimensions = Sequence[int | str | None]


@dataclass(frozen=True)
class NetworkOptions:
    """Holds what the user said about a network; None where it is to be found out.

    form: of the input, except its layout and dtype. size: width and height of the input.
    """

    form: InputForm = field(default_factory=InputForm)
    size: tuple[int, int] | None = None
    layout: str | None = None
    activation: str | None = None
    output: str | None = None


@dataclass(frozen=True)
class NetworkForm:
    """Describes a network that was run. size: width and height of its input; maps: of its scores."""

    details: ClassesDetails
    size: tuple[int, int]
    maps: tuple[int, int]
    features: int | None
    """The number of channels of its features; None without features."""


def network_form(model: Path, words: ClassWords, wishes: NetworkOptions) -> NetworkForm:
    """Open the network and run it on noise and on grey. Raises BundleError and PerceiverError."""
    runtime = Runtime()
    session = open_session(model, runtime)
    if len(session.get_inputs()) != 1:
        names = ", ".join(each.name for each in session.get_inputs())
        raise BundleError(f"the network has the inputs {names}: one is expected, the picture")
    given = session.get_inputs()[0]
    if given.type not in _DTYPES:
        raise BundleError(f"the network's input is {given.type}: export it with {' or '.join(_DTYPES)}")
    layout = _layout(given.shape, wishes.layout)
    size = _size(given.shape, layout, wishes.size)
    if given.type == "tensor(uint8)":
        form = InputForm(layout, "uint8", wishes.form.order, scale=1.0)
    else:
        form = replace(wishes.form, layout=layout)
    output = _output([each.name for each in session.get_outputs()], wishes.output)
    del session
    single = len(words.classes) == 1
    details = ClassesDetails(words, "sigmoid" if single else "softmax", form, output)
    network = Network(model, details, runtime)
    tried = [network.raw(picture) for picture in _pictures(*size)]
    if not all(np.isfinite(maps).all() for maps in tried[0] + tried[1]):
        raise BundleError(
            "the network's output is not finite on a picture of noise: it is broken, or --mean and --std are"
        )
    scores = np.stack([maps[0] for maps in tried])
    details = replace(details, activation=_activation(scores, wishes.activation))
    height, width = scores.shape[2:]
    return NetworkForm(details, size, (width, height), len(tried[0][1]) if network.has_features else None)


def _layout(shape: Dimensions, wanted: str | None) -> str:
    """Find out which axis of the input holds the three colours."""
    if len(shape) != 4 or (isinstance(shape[0], int) and shape[0] != 1):
        raise BundleError(
            f"the network's input has the shape {_shape_text(shape)}, expected is one picture: "
            "(1, 3, height, width) or (1, height, width, 3)"
        )
    axes = dict(zip(LAYOUTS, (shape[1], shape[3]), strict=True))
    possible = [layout for layout, size in axes.items() if size == 3 or not isinstance(size, int)]
    sure = [layout for layout, size in axes.items() if size == 3]
    if wanted is not None:
        if wanted not in possible:
            raise BundleError(
                f"the network's input has the shape {_shape_text(shape)}, which is not {wanted}"
            )
        return wanted
    found = sure or possible
    if len(found) != 1:
        problem = "may be either layout: say --layout nchw or nhwc" if found else "has no three colours"
        raise BundleError(f"the network's input has the shape {_shape_text(shape)}, which {problem}")
    return found[0]


def _size(shape: Dimensions, layout: str, wanted: tuple[int, int] | None) -> tuple[int, int]:
    """Find out the width and height of the input."""
    height, width = (shape[2], shape[3]) if layout == "nchw" else (shape[1], shape[2])
    own = (width, height)
    if wanted is None:
        if not (isinstance(width, int) and isinstance(height, int)):
            raise BundleError(
                "the network leaves the size of its input free: say --size WxH, the one it was trained with"
            )
        return width, height
    if any(isinstance(fixed, int) and fixed != asked for fixed, asked in zip(own, wanted, strict=True)):
        raise BundleError(
            f"the network's input is {_shape_text(shape)}, not {wanted[0]}x{wanted[1]}: leave --size out"
        )
    return wanted


def _output(names: Sequence[str], wanted: str | None) -> str:
    """Choose the output that holds the scores."""
    candidates = [name for name in names if name != FEATURES]
    if wanted is not None and wanted not in names:
        raise BundleError(f'the network has no output "{wanted}": choose {" or ".join(candidates)}')
    if wanted is None and not candidates:
        raise BundleError(f'the network has no output but "{FEATURES}": its scores are missing')
    return wanted or candidates[0]


def _activation(scores: NDArray[np.float32], wanted: str | None) -> str:
    """Choose the activation to apply to the scores, (pictures, classes, h, w), by their values."""
    bounded = float(scores.min()) >= -_TOLERANCE and float(scores.max()) <= 1.0 + _TOLERANCE
    several = scores.shape[1] > 1
    shared = bounded and several and bool((np.abs(scores.sum(axis=1) - 1.0) < _TOLERANCE).all())
    if wanted is None:
        if shared:
            return "probabilities"
        return "none" if bounded else "softmax" if several else "sigmoid"
    if shared and wanted in ("softmax", "sigmoid"):
        raise BundleError(
            f"the network's values sum to 1 already, {wanted} would blur them: leave --activation out"
        )
    if (wanted == "probabilities" and not shared) or (wanted == "none" and not bounded):
        what = "do not sum to 1" if bounded else f"go from {scores.min():.3g} to {scores.max():.3g}"
        raise BundleError(f"the network's values {what}, which is not {wanted}: leave --activation out")
    if wanted == "softmax" and not several:
        raise BundleError("a single class has no softmax: leave --activation out")
    return wanted


def _pictures(width: int, height: int) -> list[NDArray[np.uint8]]:
    noise = np.random.default_rng(0).integers(0, 256, (height, width, 3), dtype=np.uint8)
    return [noise, np.full_like(noise, 128)]


def _shape_text(shape: Dimensions) -> str:
    return "x".join(str(size) if isinstance(size, int) else "?" for size in shape)
