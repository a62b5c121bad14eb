"""Frames for the recording are encoded beside judging, one at a time; what nobody records costs nothing."""

from __future__ import annotations

import threading
import time

import cv2
import numpy as np
import pytest

from anytraverse.frame import Frame
from companion.vision import beside, pictures
from companion.vision.beside import BesideJudging
from companion.vision.messages import Encode, Encoded
from companion.vision.worker import RECENT, Worker
from tests.companion.daemon.rig import picture
from tests.companion.vision.played import engine
from tests.waiting import wait_for


def looked(number: int = 1, thing: str = "drum") -> Worker:
    worker = Worker(engine(None), 1)
    worker.judge(Frame(number, time.monotonic(), picture(thing)))
    return worker


def opened(content: bytes) -> np.ndarray:
    found = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_UNCHANGED)
    assert found is not None
    return found


def encoded(worker: Worker, number: int) -> Encoded:
    (report,) = worker.handle(Encode(7, number))
    assert isinstance(report, Encoded)
    assert (report.number, report.frame_id) == (7, number)
    return report


def test_a_frame_is_encoded_as_captured_with_its_maps() -> None:
    worker = looked()
    report, seen = encoded(worker, 1), worker.recent(1)
    assert seen is not None
    assert seen.maps is not None
    colours = opened(report.picture)[..., ::-1].astype(int)
    assert colours.shape == seen.frame.image.shape
    assert abs(colours - seen.frame.image).mean() < 12
    for content, values in (
        (report.traversability, (seen.maps.signed + 1) / 2),
        (report.uncertainty, seen.maps.uncertainty),
    ):
        grey = opened(content)
        assert grey.dtype == np.uint8
        assert grey.shape == values.shape
        assert abs(grey / 255.0 - values).max() <= 0.5 / 255 + 1e-6


def test_a_large_map_is_made_small(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(pictures, "RECORDED_MAP", 10)
    worker = looked()
    seen = worker.recent(1)
    assert seen is not None
    assert seen.maps is not None
    height, width = seen.maps.signed.shape
    assert opened(encoded(worker, 1).uncertainty).shape == (round(height * 10 / width), 10)


def test_a_frame_that_is_gone_or_cannot_be_encoded_is_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    worker = looked()
    for number in range(2, 2 + RECENT):
        worker.judge(Frame(number, time.monotonic(), picture("drum")))
    assert encoded(worker, 1).picture == b""
    monkeypatch.setattr(pictures, "LARGEST_JPEG", 100)
    assert encoded(worker, 2) == Encoded(7, 2)


def test_one_is_encoded_at_a_time_and_others_are_left_out(monkeypatch: pytest.MonkeyPatch) -> None:
    goes_on = threading.Event()

    def slow(request: Encode, _: object) -> Encoded:
        goes_on.wait(10.0)
        return Encoded(request.number, request.frame_id, b"jpeg")

    monkeypatch.setattr(beside, "encoded", slow)
    encoder, seen = BesideJudging(), looked().recent(1)
    assert encoder._thread is None, "what is not recorded costs no thread"
    began = time.monotonic()
    encoder.start(Encode(1, 1), seen)
    encoder.start(Encode(2, 1), seen)
    assert time.monotonic() - began < 0.2
    assert encoder.take() == Encoded(2, 1)
    assert encoder.take() is None
    goes_on.set()
    assert wait_for(encoder.take, 5.0) == Encoded(1, 1, b"jpeg")
    encoder.start(Encode(3, 1), seen)
    done = wait_for(encoder.take, 5.0)
    assert done.number == 3
