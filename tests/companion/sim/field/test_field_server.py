"""The running field with cameras of the tests' own: slow ones and broken ones."""

from __future__ import annotations

import contextlib
import threading
import time
from collections.abc import Iterator

import numpy as np
import pytest
from numpy.typing import NDArray

from companion.cameras.field import FrameStream
from companion.sim.field.control import FieldControl
from companion.sim.field.motion import LEVEL, Tilt
from companion.sim.field.server import FieldOptions, FieldServer
from companion.sim.field.things import World
from companion.sim.field.trail import TrailPose

Picture = NDArray[np.uint8]


class SlowCamera:
    """Takes longer for a frame than there is time."""

    def render(self, pose: TrailPose, t: float, tilt: Tilt = LEVEL) -> tuple[Picture, Picture]:
        del pose, t, tilt
        time.sleep(0.2)
        return np.zeros((8, 8, 3), np.uint8), np.zeros((8, 8), np.uint8)


class BrokenCamera:
    def render(self, pose: TrailPose, t: float, tilt: Tilt = LEVEL) -> tuple[Picture, Picture]:
        raise RuntimeError(f"no picture of {pose} at {t}, {tilt}")


@contextlib.contextmanager
def running(server: FieldServer) -> Iterator[FieldControl]:
    loop = threading.Thread(target=server.run)
    loop.start()
    host, port = server.addresses()["control"].split(":")
    try:
        with FieldControl(host, int(port)) as control:
            yield control
    finally:
        server.stop()
        loop.join()


@pytest.mark.slow
def test_physics_keeps_time_while_the_camera_is_too_slow_for_its_rate() -> None:
    server = FieldServer(World(1), SlowCamera(), FieldOptions(fps=50.0, autostart=True))
    with running(server) as control:
        first, begun = control.status(), time.monotonic()
        time.sleep(1.2)
        last, elapsed = control.status(), time.monotonic() - begun
    assert last["t"] - first["t"] == pytest.approx(elapsed, abs=0.1)
    assert last["speed"] > 0.5
    assert last["frames"] - first["frames"] <= 8


def test_a_frame_is_stamped_when_its_light_was_caught_not_when_it_was_drawn() -> None:
    server = FieldServer(World(1), SlowCamera(), FieldOptions(fps=50.0))
    with running(server):
        host, port = server.addresses()["frames"].split(":")
        with FrameStream(host, int(port)) as stream:
            frame = stream.read(timeout=3.0)
    assert time.monotonic() - frame.captured_at >= 0.2


def test_a_camera_that_breaks_ends_the_field_with_its_reason() -> None:
    server = FieldServer(World(1), BrokenCamera(), FieldOptions(duration=10.0))
    begun = time.monotonic()
    with pytest.raises(RuntimeError, match="no picture of"):
        server.run()
    assert time.monotonic() - begun < 5.0


def test_it_ends_after_its_duration() -> None:
    server = FieldServer(World(1), SlowCamera(), FieldOptions(duration=0.3))
    begun = time.monotonic()
    server.run()
    assert 0.3 <= time.monotonic() - begun < 2.0
