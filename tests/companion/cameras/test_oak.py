"""The OAK's pictures, by DepthAI's own replay node; and what is said without a device."""

from __future__ import annotations

import subprocess
import sys
import time
from datetime import timedelta
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from companion.cameras import Camera, CameraError, CameraOptions, SourceError, open_camera, split_source

_RATE = 20.0


def _read_to_its_end(camera: Camera) -> None:
    for _ in range(100):
        camera.read(5.0)


def test_an_oak_needs_no_place() -> None:
    assert split_source("oak:") == ("oak", "")
    assert split_source("oak:14442C10D13EABCE00") == ("oak", "14442C10D13EABCE00")


def test_without_depthai_the_extra_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "depthai", None)
    monkeypatch.delitem(sys.modules, "companion.cameras.oak", raising=False)
    with pytest.raises(SourceError, match=r"anytraverse-companion\[oak\]"):
        open_camera("oak:")


def test_a_device_that_is_absent_is_told_without_waiting_for_it() -> None:
    pytest.importorskip("depthai", reason="needs the extra oak")
    with pytest.raises(CameraError, match="no OAK"):
        open_camera("oak:")
    began = time.monotonic()
    with pytest.raises(CameraError, match="no OAK"):
        open_camera("oak:14442C10D13EABCE00")
    assert time.monotonic() - began < 5.0


def test_telemetry_is_off_before_depthai_is_imported() -> None:
    script = (
        "import os, sys\n"
        "class Finder:\n"
        "    def find_spec(self, name, *_):\n"
        "        if name == 'depthai': print(os.environ.get('DEPTHAI_TELEMETRY')); raise SystemExit\n"
        "sys.meta_path.insert(0, Finder())\n"
        "import companion.cameras.oak"
    )
    command = [sys.executable, "-c", script]
    ran = subprocess.run(command, capture_output=True, text=True, timeout=60, check=True)
    assert ran.stdout.strip() == "0"


def test_replayed_pictures_come_in_their_colours_with_the_time_of_depthai_until_the_pipeline_ends(
    tmp_path: Path,
) -> None:
    dai = pytest.importorskip("depthai", reason="needs the extra oak")
    from companion.cameras.oak import OakStream

    path = tmp_path / "drive.mp4"
    film = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"mp4v"), _RATE, (640, 480))
    for _ in range(20):
        film.write(np.full((480, 640, 3), (0, 0, 200), np.uint8))
    film.release()
    pipeline = dai.Pipeline(createImplicitDevice=False)
    replay = pipeline.create(dai.node.ReplayVideo)
    replay.setReplayVideoFile(path)
    replay.setOutFrameType(dai.ImgFrame.Type.BGR888p)
    replay.setSize(640, 480)
    replay.setFps(_RATE)
    replay.setLoop(False)
    camera = OakStream(pipeline, replay.out, CameraOptions(freshness=2.0))
    try:
        times = []
        for _ in range(10):
            capture = camera.read(5.0)
            assert capture.image.shape == (480, 640, 3)
            assert abs(int(capture.image[240, 320, 0]) - 200) < 8
            assert capture.image[240, 320, 2] < 8
            assert capture.timed_by == "sensor"
            assert (capture.depth, capture.intrinsics) == (None, None)
            assert 0.0 <= time.monotonic() - capture.captured_at < 1.0
            times.append(capture.captured_at)
        assert times == sorted(times)
        with pytest.raises(CameraError, match="the OAK is gone"):
            _read_to_its_end(camera)
    finally:
        camera.close()


def test_each_picture_comes_with_the_depth_of_its_own_time_and_with_its_intrinsics() -> None:
    dai: Any = pytest.importorskip("depthai", reason="needs the extra oak")
    from companion.cameras.oak import OakStream

    class Device(dai.node.ThreadedHostNode):  # type: ignore[misc]
        """Sends every picture, and of every third no depth map. A map says the number of its picture."""

        def __init__(self) -> None:
            super().__init__()
            self.colour, self.depth = self.createOutput(), self.createOutput()

        def run(self) -> None:
            number = 0
            while self.isRunning():
                number += 1
                lens = [[500.0 / 8, 0.0, 32.5], [0.0, 500.0 / 8, 23.5], [0.0, 0.0, 1.0]]
                colour = dai.ImgFrame().setCvFrame(
                    np.full((48, 64, 3), (0, 0, number % 250), np.uint8), dai.ImgFrame.Type.BGR888p
                )
                colour.setTransformation(dai.ImgTransformation(64, 48, lens))
                depth = dai.ImgFrame().setCvFrame(
                    np.full((48, 64), 1000 + number % 250, np.uint16), dai.ImgFrame.Type.RAW16
                )
                taken = timedelta(seconds=time.monotonic())
                for output, frame in ((self.colour, colour), (self.depth, depth)):
                    frame.setTimestamp(taken)
                    if output is self.colour or number % 3:
                        output.send(frame)
                time.sleep(0.05)

    pipeline = dai.Pipeline(createImplicitDevice=False)
    device = pipeline.create(Device)
    camera = OakStream(pipeline, device.colour, CameraOptions(fps=_RATE), device.depth)
    try:
        for _ in range(8):
            capture = camera.read(5.0)
            assert capture.depth is not None
            assert (capture.depth.dtype, capture.depth.shape) == (np.dtype(np.uint16), (48, 64))
            number = int(capture.depth[0, 0]) - 1000
            assert abs(int(capture.image[24, 32, 0]) - number) < 3
            assert number % 3, "it had no depth"
            assert capture.intrinsics == (62.5, 62.5, 32.5, 23.5)
    finally:
        camera.close()
        pipeline.wait()
