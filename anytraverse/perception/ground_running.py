"""Running the built-in network: with ONNX Runtime, or with OpenCV where that is not installed."""

from __future__ import annotations

from collections.abc import Callable
from importlib.util import find_spec
from pathlib import Path

import cv2
import numpy as np

from anytraverse.errors import PerceiverError
from anytraverse.perception.ground_net import Floats
from anytraverse.perception.runtime import Runtime, open_session, run_session

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
