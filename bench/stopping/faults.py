"""Defines the faults that must stop a driving rover: how each begins and ends."""

from __future__ import annotations

import signal
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from bench.stopping.stage import Stage
from companion.calls.numbers import Numbers

Act = Callable[[Stage], None]
AUTOPILOT_SILENT = Numbers().heartbeat_lost


@dataclass(frozen=True)
class Fault:
    """How a fault begins and ends. end: None if it cannot be undone: then it is the last on its stage."""

    begin: Act
    end: Act | None
    noticed: float = 0.0
    """Seconds until the companion can notice the fault, if that is longer than T."""
    returns: bool = False
    """Whether the companion recovers by itself; then the time for that is measured."""
    alone: bool = False
    """Whether the fault needs a companion whose vision process has never died."""


def _signal(number: signal.Signals) -> Act:
    return lambda stage: stage.daemon.process.send_signal(number)


def _cut(*, on: bool) -> Act:
    return lambda stage: setattr(stage.wire, "cut", on)


def _mute(*, on: bool) -> Act:
    return lambda stage: setattr(stage.wire, "mute", on)


def _freeze(*, on: bool, clock: bool = False) -> Act:
    def act(stage: Stage) -> None:
        stage.camera.clock, stage.camera.frozen = clock and on, on

    return act


def _cover(*, on: bool) -> Act:
    return lambda stage: stage.freeze_camera(on=on)


def _break(how: str) -> Act:
    return lambda stage: stage.break_perceiver(how)


CAMERA: Mapping[str, Fault] = {
    "frozen_camera": Fault(_freeze(on=True), _freeze(on=False)),
    "frozen_with_clock": Fault(_freeze(on=True, clock=True), _freeze(on=False)),
    "silent_camera": Fault(_cover(on=True), _cover(on=False)),
}
SILENCE: Mapping[str, Fault] = {
    "sigstop": Fault(_signal(signal.SIGSTOP), _signal(signal.SIGCONT)),
    "dead_link": Fault(_cut(on=True), _cut(on=False)),
    "one_way_wire": Fault(_mute(on=True), _mute(on=False), noticed=AUTOPILOT_SILENT),
    "kill_9": Fault(_signal(signal.SIGKILL), None),
}
BREAKABLE: Mapping[str, Fault] = {
    "nan_maps": Fault(_break("nan"), _break("")),
    "hung_perceiver": Fault(_break("hang"), _break(""), returns=True, alone=True),
    "vision_segfault": Fault(_break("segfault"), _break(""), alone=True),
    "vision_lock_hang": Fault(_break("lock"), _break(""), returns=True, alone=True),
    "vision_out_of_memory": Fault(_break("memory"), _break(""), alone=True),
}
"""Faults of a companion whose perceiver can be broken."""
FAINT = {"nan_maps": Fault(_break("one nan"), _break(""))}
"""The same faults in their smallest form, for every other seed."""
