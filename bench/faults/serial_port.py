"""The row of the fault table of a serial device that takes nothing any more."""

from __future__ import annotations

import contextlib
import os
import pty
import socket
import threading
import time
import tty
from contextlib import ExitStack, closing

from bench.faults.row import Outcome, Row, Work
from bench.faults.standing import Standing, repeating
from bench.faults.standing_calls import held_call
from bench.faults.standing_wire import HOST, SYSTEM
from companion.wire.ids import Motion, State

_SAID = "takes nothing: check its cable and flow control"
_BUDGETS = "budget = 0\nasked_budget = 0\npace = 0", "asked_budget = 2000\nbudget = 800\npace = 0"
_TAKEN_OVER, _MANUAL = "taken over", 0
_WELL = (State.OK, State.CALLING, State.HOLDING)


class SerialDevice:
    """Passes bytes between a pseudo-terminal, which the companion opens, and an autopilot on UDP.

    stuck: nothing is taken from the companion, whose kernel keeps what it writes; the other way goes on.
    """

    def __init__(self, port: int) -> None:
        """port: where the autopilot expects the companion, of 127.0.0.1."""
        self._master, self._slave = pty.openpty()
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        os.set_blocking(self._slave, False)
        self.url = f"serial:{os.ttyname(self._slave)}:57600"
        self.stuck = False
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.bind((HOST, port))
        self._socket.settimeout(0)
        self._autopilot: tuple[str, int] | None = None
        self._over = threading.Event()
        self._thread = threading.Thread(target=self._pass, name="serial device", daemon=True)
        self._thread.start()

    def close(self) -> None:
        self._over.set()
        self._thread.join()
        self._socket.close()
        os.close(self._slave)
        os.close(self._master)

    def _pass(self) -> None:
        while not self._over.wait(0.002):
            with contextlib.suppress(OSError):
                data, self._autopilot = self._socket.recvfrom(4096)
                os.write(self._master, data)
            with contextlib.suppress(OSError):
                if self.stuck:
                    while True:  # a pseudo-terminal would keep a minute of our frames
                        os.write(self._slave, bytes(64))
                data = os.read(self._master, 4096)
                if self._autopilot is not None:
                    self._socket.sendto(data, self._autopilot)


def _stuck(work: Work) -> Outcome:
    """The device takes nothing while a go is carried out, and a human takes over before it is well."""
    wrong = list[str]()
    with ExitStack() as stack:
        rover = stack.enter_context(Standing(work.folder, policy="hold", seed=work.seed, listens=True))
        device = stack.enter_context(closing(SerialDevice(int(rover.wire.url.rpartition(":")[2]))))
        text = rover.config.read_text(encoding="utf-8").replace(rover.wire.url, device.url)
        rover.config.write_text(text.replace(*_BUDGETS), encoding="utf-8")
        rover.start()
        call = held_call(rover)
        rover.thing = False
        rover.run(1.0)
        device.stuck, since = True, len(rover.wire.modes)
        rover.run(0.3)
        rover.client.answer(SYSTEM, call, Motion.GO, (), time.monotonic())
        rover.wait("the device's trouble", lambda: _SAID in rover.log, 10.0)
        rover.wire.mode = _MANUAL
        rover.wait("the taking over", lambda: _TAKEN_OVER in rover.log, 10.0)
        rover.run(1.0)
        device.stuck, began = False, time.monotonic()
        silence = rover.client.rovers[SYSTEM].silence
        rover.wait("the companion", lambda: silence(time.monotonic()) < time.monotonic() - began, 15.0)
        rover.wait("its view", lambda: rover.heartbeat in _WELL, 15.0)
        back = time.monotonic() - began
        rover.run(3.0)
        late = [mode for _, mode in rover.wire.modes[since:]]
        if late or rover.wire.mode != _MANUAL:
            wrong.append(f"commanded when it took bytes again: {late}")
    return Outcome(1, tuple(wrong), None, back, f'log: "{_SAID}"; the way back that was under way never left')


ROWS: tuple[Row, ...] = (
    repeating(
        "serial device stuck",
        "the autopilot's port takes no byte; a go is given, a human sets MANUAL; then it takes all again",
        "told; no command to drive on leaves late; the rover stays in MANUAL; well again",
        5,
        _stuck,
    ),
)
"""Of the port to the autopilot."""
