"""The built-in network: how it is run, the size it wants, and what its outputs mean."""

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
"""Both sides of the network's input are multiples of it."""
LEAST_HEIGHT, GREATEST_HEIGHT, GREATEST_WIDTH = 128, 256, 512


@dataclass(frozen=True, eq=False)
class Calibration:
    """The numbers beside a network of C classes and D features, written with it by its training.

    classes: their names, in the order of the logits. bias (C,): added to the logits. gamma: see `attention`.
    tap_mean (T,), tap_whitening (T, T): of the background that tapped things stand out from, T = D + 5.
    scene_mean (4 D,), scene_projection (S, 4 D), scene_threshold: see ground_scene.py.
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
        """Write it as .npz."""
        values: dict[str, Any] = {field.name: np.asarray(getattr(self, field.name)) for field in fields(self)}
        with path.open("wb") as file:
            np.savez_compressed(file, **values)

    @classmethod
    def load(cls, path: Path) -> Calibration:
        """Read it back. Raises PerceiverError when it is missing, torn or not finite."""
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
    """Width and height of the network's input for a frame of this size.

    256 wide and as high as the frame's aspect asks, in steps of 16; frames flatter than 2:1 are 128 high and
    wider instead, up to 512. What then remains of the aspect is stretched, by 6 % at most for common cameras.
    """
    wide, high = WIDTH, _stepped(WIDTH * height / width)
    if high < LEAST_HEIGHT:
        wide, high = _stepped(LEAST_HEIGHT * width / height), LEAST_HEIGHT
    return min(wide, GREATEST_WIDTH), min(high, GREATEST_HEIGHT)


def network_input(image: Image) -> Floats:
    """The frame as the network wants it, (1, 3, h, w) float32 RGB 0 to 255."""
    size = network_size(image.shape[1], image.shape[0])
    small = cv2.resize(image, size, interpolation=cv2.INTER_AREA)
    return np.ascontiguousarray(small.transpose(2, 0, 1)[None], dtype=np.float32)


def posteriors(logits: Floats, calibration: Calibration) -> Floats:
    """Probabilities of the classes, (C, h, w): the softmax of calibrated logits."""
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
    """Attention of N words, (N, h, w) in [0, 1], from the posteriors (C, h, w).

    covers (N, C): 1 where a word explains a class, else 0. own (N, C): how much a class speaks for a word
    when words compete. fits (N, h, w) or None: how well a point's colours suit each word, to the same end.
    reach (N, h, w) or None: how much of what it covers each word explains at each point; None is all of it.
    unknown: the class of what has no name; None where there is none, or a word for every other class.
    K = (1 - posterior of `unknown`)^gamma x (share of the covered classes in all with a name) is how well the
    words explain a point together: gamma makes sure of things without a name, while ground between two names
    of which one is asked for is as known as that is likely. Without `unknown`, all that is not covered is.
    A word gets K times its own evidence over that of the best word. So 1 - max is 1 - K, a synonym explains
    nothing twice, and what no asked word means stays low in all of them.
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
    """What runs this network. Raises PerceiverError for one that cannot be read or has other outputs."""
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
    """OpenCV runs on as many cores as cv2.setNumThreads says: that is the whole process's choice."""
    # The engine that OpenCV 5 prefers fails on this network; OpenCV 4 has but one. From bytes in memory it
    # takes its own choice whatever is asked for, from a file it does not.
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
        # What OpenCV gives back is its own memory, which the next run overwrites.
        return np.array(logits[0]), np.array(features[0])

    return run
