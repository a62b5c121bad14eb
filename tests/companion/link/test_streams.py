"""What a stream says of its device: whether it is stuck, idle, settled, and has room."""

from __future__ import annotations

import os
import pty
import tty
from collections.abc import Callable

import pytest

from companion.config.link_settings import LinkSettings
from companion.link import streams
from companion.link.streams import ROOM, STUCK_AFTER, Serial, Stream, StuckError

Hold = Callable[[int], None]
"""Makes the kernel hold so many bytes."""


@pytest.fixture
def hold(monkeypatch: pytest.MonkeyPatch) -> Hold:
    def hold(count: int) -> None:
        monkeypatch.setattr(streams, "unconfirmed_bytes", lambda _: count)

    hold(0)
    return hold


class Device(Stream):
    """A device that takes `room` more bytes, whose frame before has left."""

    def __init__(self) -> None:
        super().__init__()
        self.room = 1000
        assert self.write(b"first")

    def _send(self, data: bytes) -> int:
        taken = min(len(data), self.room)
        self.room -= taken
        return taken

    def _drop(self) -> None:
        """Do nothing: the kernel is not there."""

    def fileno(self) -> int:
        return -1


@pytest.mark.usefixtures("hold")
def test_a_device_is_stuck_one_second_after_it_took_its_last_byte() -> None:
    device = Device()
    device.room = 1
    assert device.write(b"frame")
    device.check(10.0)
    device.room = 1
    device.check(10.5)
    device.check(10.375 + STUCK_AFTER)
    with pytest.raises(StuckError):
        device.check(10.5 + STUCK_AFTER)


def test_a_device_is_idle_and_settled_only_once_its_kernel_holds_nothing(hold: Hold) -> None:
    device = Device()
    device.note_revocable()
    assert device.idle()
    assert not device.settled(), "its kernel never told that anything waits, so it may never tell"
    hold(1)
    assert not device.idle()
    assert not device.settled()
    hold(0)
    assert device.idle()
    assert device.settled()


def test_a_serial_line_has_room_while_its_kernel_holds_a_tenth_of_a_second(hold: Hold) -> None:
    pytest.importorskip("serial")
    master, slave = pty.openpty()
    tty.setraw(slave)
    serial = Serial(LinkSettings(f"serial:{os.ttyname(slave)}:57600").address())
    hold(round(ROOM * serial.rate))
    assert serial.has_room()
    hold(round(ROOM * serial.rate) + 1)
    assert not serial.has_room()
    serial.close()
    os.close(slave)
    os.close(master)
