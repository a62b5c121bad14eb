"""A serial port that does not open says what to do, at either end of the link."""

from __future__ import annotations

import errno
import os
import pty
import threading
import tty
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest

from companion.config.link_settings import LinkSettings
from companion.link.transport import open_transport
from companion.wire import devices
from companion.wire.devices import open_port
from gcs_plugin.terminal.connection import open_connection

serial = pytest.importorskip("serial")


@pytest.fixture
def device() -> Iterator[str]:
    master, slave = pty.openpty()
    tty.setraw(slave)
    yield os.ttyname(slave)
    os.close(slave)
    os.close(master)


def test_a_port_that_is_not_there_is_named_with_where_to_look(tmp_path: Path) -> None:
    absent = f"serial:{tmp_path}/radio:57600"
    told = f"{tmp_path}/radio is not there: plug it in, or find its name in /dev/serial/by-id"
    connection = open_connection(absent)
    assert connection.read() == b""
    assert connection.trouble == told
    with pytest.raises(OSError, match="is not there") as failed:
        open_transport(LinkSettings(absent).address())
    assert failed.value.strerror == told


def test_a_port_that_another_program_holds_is_said_to_be_in_use(device: str) -> None:
    held = open_port(device, 57600)
    with pytest.raises(OSError, match="in use by another program"):
        open_port(device, 57600)
    held.close()
    open_port(device, 57600).close()


@pytest.mark.parametrize(
    ("number", "told"),
    [(errno.EACCES, "usermod -aG dialout USER"), (errno.EBUSY, "in use by another program")],
)
def test_a_port_that_the_user_may_not_open_or_a_modem_manager_holds_says_what_to_do(
    monkeypatch: pytest.MonkeyPatch, number: int, told: str
) -> None:
    def refuse(*_: object, **__: object) -> None:
        raise serial.SerialException(number, "could not open port /dev/ttyACM0")

    monkeypatch.setattr(serial, "Serial", refuse)
    with pytest.raises(OSError, match=told) as failed:
        open_port("/dev/ttyACM0", 57600)
    assert failed.value.errno == number


@pytest.mark.slow
def test_a_port_whose_closing_takes_long_blocks_nothing_and_is_not_opened_meanwhile(
    device: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    may_close = threading.Event()
    close = serial.Serial.close

    def slowly(port: Any) -> None:
        may_close.wait(5.0)
        close(port)

    monkeypatch.setattr(serial.Serial, "close", slowly)
    open_port(device, 57600).close()
    with pytest.raises(OSError, match="still being closed: it takes nothing"):
        open_port(device, 57600)
    may_close.set()
    devices._closing[device].join(5.0)
    open_port(device, 57600).close()


def test_a_speed_that_no_port_takes_is_trouble_at_either_end_and_no_crash(device: str) -> None:
    connection = open_connection(f"serial:{device}:99999999999")
    assert connection.read() == b""
    assert connection.trouble
