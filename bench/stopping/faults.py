"""Defines the faults that must stop a driving rover: how each begins and ends."""

from __future__ import annotations

import signal
from collections.abc import Callable, Mapping
from dataclasses import dataclass

from bench.stopping.perceivers import SHAPES
from bench.stopping.stage import Stage
from companion.calls.numbers import Numbers
from companion.vision.measured_pace import BAD_FOR

Act = Callable[[Stage], None]
AUTOPILOT_SILENT = Numbers().heartbeat_lost


@dataclass(frozen=True)
class InjectedFault:
    """How a fault begins and ends."""

    begin: Act
    end: Act
    noticed: float = 0.0
    """Seconds until the companion can notice the fault, if that is longer than T."""
    returns: bool = False
    """Whether the companion recovers by itself, before `end`."""
    silences: bool = False
    """Whether the companion cannot command the autopilot, so that only the script can hold."""
    alone: bool = False
    """Whether it needs a stage of its own: vision may not have died before, or a call stays open after it."""


def _signal(number: signal.Signals) -> Act:
    return lambda stage: stage.daemon.process.send_signal(number)


def _cut(*directions: str, on: bool) -> Act:
    def act(stage: Stage) -> None:
        for direction in directions:
            setattr(stage.wire, direction, on)

    return act


def _late(seconds: float) -> Act:
    return lambda stage: setattr(stage.wire, "delay", seconds)


def _set(name: str, value: object) -> Act:
    return lambda stage: setattr(stage.camera, name, value)


def _plug(*, on: bool) -> Act:
    return lambda stage: stage.camera.plug(on=on)


def _freeze(*, on: bool, clock: bool = False) -> Act:
    def act(stage: Stage) -> None:
        stage.camera.clock, stage.camera.frozen = clock and on, on

    return act


def _cover(*, on: bool) -> Act:
    return lambda stage: stage.freeze_camera(on=on)


def _break(how: str) -> Act:
    return lambda stage: stage.break_perceiver(how)


CAMERA: Mapping[str, InjectedFault] = {
    "frozen_camera": InjectedFault(_freeze(on=True), _freeze(on=False)),
    "frozen_with_clock": InjectedFault(_freeze(on=True, clock=True), _freeze(on=False)),
    "silent_camera": InjectedFault(_cover(on=True), _cover(on=False)),
}
UNPLUGGED = InjectedFault(_plug(on=False), _plug(on=True))
BLACK = InjectedFault(_set("black", 1), _set("black", 0), alone=True)
SLOW = InjectedFault(_set("pause", 2.5), _set("pause", 0.0))
"""A picture every 2.5 s, where T is 1 s."""
SILENCE: Mapping[str, InjectedFault] = {
    "sigstop": InjectedFault(_signal(signal.SIGSTOP), _signal(signal.SIGCONT), silences=True),
    "dead_link": InjectedFault(
        _cut("mute", "unheard", on=True), _cut("mute", "unheard", on=False), silences=True
    ),
    "one_way_wire": InjectedFault(
        _cut("mute", on=True), _cut("mute", on=False), noticed=AUTOPILOT_SILENT, silences=True
    ),
    "kill_9": InjectedFault(_signal(signal.SIGKILL), lambda stage: stage.start_daemon(), silences=True),
}
UNHEARD = InjectedFault(_cut("unheard", on=True), _cut("unheard", on=False), silences=True)
"""Nothing reaches the autopilot from the companion, which hears it."""
BREAKABLE: Mapping[str, InjectedFault] = {
    "nan_maps": InjectedFault(_break("nan"), _break("")),
    "hung_perceiver": InjectedFault(_break("hang"), _break(""), returns=True, alone=True),
    "vision_segfault": InjectedFault(_break("segfault"), _break(""), alone=True),
    "vision_lock_hang": InjectedFault(_break("lock"), _break(""), returns=True, alone=True),
    "vision_out_of_memory": InjectedFault(_break("memory"), _break(""), alone=True),
    # Two of such pictures take a little longer than T, 1 s, with what they take anyway.
    "slow_frames": InjectedFault(_break("slow 0.45"), _break(""), noticed=BAD_FOR + 1.0),
}
"""Faults of a companion whose perceiver can be broken."""
WRONG_SHAPES: Mapping[str, InjectedFault] = {
    name: InjectedFault(_break(f"shape {name}"), _break("")) for name in (*SHAPES, "embedding")
}
GUIDING: Mapping[str, InjectedFault] = {
    **{name: SILENCE[name] for name in ("kill_9", "sigstop")},
    "hung_main_loop": InjectedFault(_signal(signal.SIGUSR1), _signal(signal.SIGKILL), silences=True),
    "frozen_camera": CAMERA["frozen_camera"],
    "vision_killed": BREAKABLE["vision_out_of_memory"],
    "dead_link": SILENCE["dead_link"],
    "late_wire": InjectedFault(_late(1.0), _late(0.0), silences=True),
}
"""Faults while the companion guides."""
NO_MEMORY = InjectedFault(_break("no memory"), _break(""), alone=True)
FAINT = {"nan_maps": InjectedFault(_break("one nan"), _break(""))}
"""The same faults in their smallest form, for every other seed."""
