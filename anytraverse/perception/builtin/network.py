"""Runs the built-in network, chooses its input size, and turns its outputs into attention maps."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from importlib.util import find_spec
from pathlib import Path
from typing import Any
from zipfile import BadZipFile

import cv2
import numpy as np
from numpy.typing import NDArray

from anytraverse.errors import PerceiverError
from anytraverse.frame import Image
from anytraverse.perception.runtime import Runtime, open_session, run_session

Floats = NDArray[np.float32]

WIDTH = 256
STEP = 16
"""Both sides of the network's input are multiples of this."""
LEAST_HEIGHT, GREATEST_HEIGHT, GREATEST_WIDTH = 128, 256, 512


@dataclass(frozen=True, eq=False)
class Calibration:
    """Holds the numbers that a training writes beside a network of C classes and D features.

    classes: their names, in the order of the logits. bias (C,): added to the logits. gamma: see `attention`.
    tap_mean (T,), tap_whitening (T, T): statistics of the background, T = D + 5; see taps.py.
    scene_mean (4 D,), scene_projection (S, 4 D), scene_threshold: see scene.py.
    """

    classes: tuple[str, ...]
    bias: Floats
    gamma: float
    tap_mean: Floats
    tap_whitening: Floats
    scene_mean: Floats
    scene_projection: Floats
    scene_threshold: float

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
        except (OSError, ValueError, KeyError, BadZipFile) as error:
            raise PerceiverError(
                f"the calibration {path.name} cannot be read ({error}): install it again"
            ) from error
        numbers = {name: value for name, value in values.items() if name != "classes"}
        if not all(np.isfinite(value).all() for value in numbers.values()):
            raise PerceiverError(f"the calibration {path.name} is not finite: fit it again")
        for name, value in numbers.items():
            values[name] = float(value) if value.ndim == 0 else value.astype(np.float32)
        return cls(**values | {"classes": tuple(str(name) for name in values["classes"])})


def network_size(width: int, height: int) -> tuple[int, int]:
    """Choose the width and height of the network's input for a frame of this size.

    The input is 256 wide, and as high as the frame's aspect requires, in steps of 16. For a frame flatter
    than 2:1 it is 128 high, and wider instead, up to 512. The rest of the aspect is made up by stretching, at
    most 6 % for common cameras.
    """
    wide, high = WIDTH, _stepped(WIDTH * height / width)
    if high < LEAST_HEIGHT:
        wide, high = _stepped(LEAST_HEIGHT * width / height), LEAST_HEIGHT
    return min(wide, GREATEST_WIDTH), min(high, GREATEST_HEIGHT)


def network_input(image: Image) -> Floats:
    """Resize a frame to the network's input, (1, 3, h, w) float32 RGB 0 to 255."""
    size = network_size(image.shape[1], image.shape[0])
    small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    return np.ascontiguousarray(small.transpose(2, 0, 1)[None], dtype=np.float32)


def posteriors(logits: Floats, calibration: Calibration) -> Floats:
    """Calculate the probabilities of the classes, (C, h, w): the softmax of calibrated logits."""
    raised = logits + calibration.bias[:, None, None]
    powers = np.exp(raised - raised.max(axis=0))
    return np.asarray(powers / powers.sum(axis=0), dtype=np.float32)


def attention(
    probabilities: Floats,
    covers: Floats,
    own: Floats,
    gamma: float,
    fits: Floats | None = None,
    reach: Floats | None = None,
    unknown: int | None = None,
) -> Floats:
    """Calculate the attention of N words, (N, h, w) in [0, 1], from the posteriors (C, h, w).

    covers (N, C): 1 where a word explains a class, else 0. own (N, C): the weight of a class as evidence for
    a word when words compete. fits (N, h, w) or None: how well a point's colours suit each word, a factor on
    its evidence. reach (N, h, w) or None: the share of its classes that each word explains at each point;
    None: all. unknown: the index of the class of things without a name; None: whatever no word covers counts
    as unknown.

    K = (1 - posterior of `unknown`)^gamma x (share of the covered classes in all named classes) is how well
    all words together explain a point. A larger gamma makes things without a name more uncertain. It does not
    affect a point between two named classes of which one is covered: there K is the probability of that one.
    A word's attention is K times its own evidence over that of the best word. So 1 - max of all attention is
    1 - K, a synonym explains nothing twice, and what no word means is low in every map.
    """
    if not len(own):
        return np.zeros((0, *probabilities.shape[1:]), dtype=np.float32)
    if reach is None:
        covered = covers.max(axis=0)[:, None, None] * probabilities
    else:
        covered = (covers[:, :, None, None] * reach[:, None]).max(axis=0) * probabilities
    share = covered.sum(axis=0)
    named = share if unknown is None else 1.0 - (probabilities[unknown] - covered[unknown])
    named = np.clip(named, 1e-9, 1.0)
    explained = named**gamma * np.clip(share / named, 0.0, 1.0)
    evidence = np.tensordot(own, probabilities, 1)
    if fits is not None:
        evidence *= fits
    return np.asarray(explained * evidence / np.maximum(evidence.max(axis=0), 1e-9), dtype=np.float32)


def _stepped(pixels: float) -> int:
    return max(STEP, round(pixels / STEP) * STEP)


INPUT, OUTPUTS = "frame", ("logits", "features")

Run = Callable[[Floats], tuple[Floats, Floats]]
"""`frame` (1, 3, h, w) as of `network_input` -> logits (C, h/4, w/4) and features (D, h/4, w/4)."""


def open_network(model: Path, runtime: Runtime) -> Run:
    """Open a network. Raises PerceiverError for a file that cannot be read or that has other outputs."""
    if find_spec("onnxruntime") is None and runtime.providers == ("CPU",):
        return _with_opencv(model)
    session = open_session(model, runtime)
    if tuple(each.name for each in session.get_outputs()) != OUTPUTS:
        raise PerceiverError(
            f"{model.name}: its outputs are not {' and '.join(OUTPUTS)}: it is of another kind"
        )

    def run(frame: Floats) -> tuple[Floats, Floats]:
        logits, features = run_session(session, {INPUT: frame})
        return logits[0], features[0]

    return run


def _with_opencv(model: Path) -> Run:
    """Open a network with OpenCV. cv2.setNumThreads, for the whole process, says how many cores it uses."""
    # The engine that OpenCV 5 prefers fails on this network; OpenCV 4 has only one. OpenCV honours the choice
    # for a file, and ignores it for bytes in memory: so the path is given.
    engine = (cv2.dnn.ENGINE_CLASSIC,) if hasattr(cv2.dnn, "ENGINE_CLASSIC") else ()
    try:
        network = cv2.dnn.readNetFromONNX(str(model), *engine)
    except cv2.error as error:
        raise PerceiverError(f"OpenCV cannot load {model.name}: {' '.join(str(error).split())}") from error

    def run(frame: Floats) -> tuple[Floats, Floats]:
        try:
            network.setInput(frame, INPUT)
            logits, features = network.forward(OUTPUTS)
        except cv2.error as error:
            raise PerceiverError(f"the network failed: {' '.join(str(error).split())[:200]}") from error
        # Copied, since OpenCV returns its own memory, which the next run overwrites.
        return np.array(logits[0]), np.array(features[0])

    return run
