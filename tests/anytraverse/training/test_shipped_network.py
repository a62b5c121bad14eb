"""The network that ships: its size, its calibration, that it runs where it must, and that it sees."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import anytraverse.perception
from anytraverse.perception.builtin.network import Calibration, network_input
from anytraverse.training.classes import CLASSES

FILE = Path(anytraverse.perception.__file__).parent / "data" / "builtin.onnx"
FRAMES = Path(__file__).parents[4] / "shared" / "data" / "trail"


def test_it_is_small_and_its_calibration_fits() -> None:
    calibration = Calibration.load(FILE.with_suffix(".npz"))
    assert FILE.stat().st_size + FILE.with_suffix(".npz").stat().st_size < 600_000
    assert calibration.classes == CLASSES
    assert calibration.bias.shape == (8,)
    assert calibration.tap_whitening.shape == (37, 37)
    assert calibration.scene_projection.shape == (32, 128)
    assert 1 < calibration.gamma < 20
    assert 0 < calibration.scene_threshold < 0.9


def test_both_runtimes_agree_at_any_height() -> None:
    import cv2
    import onnxruntime

    session = onnxruntime.InferenceSession(str(FILE), providers=["CPUExecutionProvider"])
    classic = cv2.dnn.readNetFromONNX(str(FILE), getattr(cv2.dnn, "ENGINE_CLASSIC", 1))
    for height in (480, 340):
        image = np.random.default_rng(0).integers(0, 256, (height, 640, 3), dtype=np.uint8)
        frame = network_input(image)
        classic.setInput(frame)
        pairs = zip(
            session.run(["logits", "features"], {"frame": frame}),
            classic.forward(["logits", "features"]),
            strict=True,
        )
        assert all(np.abs(ours - theirs).max() < 1e-3 for ours, theirs in pairs)


@pytest.mark.skipif(
    not FRAMES.is_dir(), reason="needs the labelled frames beside the checkout: ../shared/data"
)
def test_it_sees_drives_that_it_was_not_trained_on() -> None:
    pytest.importorskip("torch", reason="needs the extra train")
    from anytraverse.training.fit import stored
    from anytraverse.training.folders import Split, read_folder
    from anytraverse.training.scores import outputs, score

    network, calibration = stored(FILE)
    held_out = Split((2,), (4,)).parts(read_folder(FRAMES))[1]
    found = score(outputs(network, held_out), calibration)
    assert found.iou > 0.8
    assert found.unexplained < 0.05
