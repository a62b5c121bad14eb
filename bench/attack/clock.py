"""Speaks with the key, but by a clock that is far ahead, and plays back what such a sender said."""

from __future__ import annotations

import os
import socket
import time
from collections.abc import Mapping
from itertools import cycle
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from anytraverse.operations import SetWord
from bench.attack.outcome import AttackOutcome, watched
from bench.faults.standing import Standing
from bench.faults.standing_wire import SYSTEM
from companion.storage.journal_copy import read_stored_memory
from companion.wire.answers import Answer
from companion.wire.ids import COMPONENT_ID, Motion
from companion.wire.signing import MAX_STREAMS, SigningKey
from gcs_plugin.client.client import OperatorClient
from gcs_plugin.terminal.connection import open_connection
from gcs_plugin.terminal.runner import Runner
from gcs_plugin.terminal.signing import OperatorSigning

DAY = 86_400.0
SECONDS, QUICK = 6.0, 3.0
HEARD_WITHIN = 10.0
_WEIGHT, _TAKEN_BACK = -1.0, 0.5
_NETWORK_CLOCK = """\
from pathlib import Path
from companion.system import computer
computer.SYNCHRONISED = Path({path!r})
"""
"""A sitecustomize.py, by which the companion looks for timesyncd's file elsewhere."""


def clock(folder: Path, *, quick: bool) -> AttackOutcome:
    """Attack a companion whose clock the network has set, and one whose clock it has not.

    The first one must hear new stations, too, also after a restart. The second one cannot tell whose clock is
    right, so that it must only hear those that it knows.
    """
    outcome = AttackOutcome()
    for name, is_set in (("set", True), ("not set", False)):
        place = folder / name.replace(" ", "-")
        place.mkdir()
        with (
            Standing(place, signs=True, listens=True) as rover,
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as attacker,
        ):
            environment = _environment(place, is_set)
            rover.start(environment)
            attacker.connect(rover.wire.companion)
            played = _attack(rover, attacker, QUICK if quick else SECONDS, outcome)
            rejected = rover.status().get("link", {}).get("rejected", {})
            heard = [_heard_after(rover)]
            if is_set:
                stations = [_station(rover, number) for number in (1, 2)]
                heard += [_heard_after(rover, stations[0])]
                rover.kill()
                rover.start(environment)
                attacker.send(played)
                heard += [_heard_after(rover, station) for station in (None, *stations)]
            weight = _weight(rover)
        if None in heard:
            outcome.reached.append(f"clock {name}: a genuine station was shut out")
        if weight != _TAKEN_BACK:
            outcome.reached.append(f"clock {name}: a frame that was played back counted")
        refused = {why: rejected.get(why, 0) for why in ("replay", "ahead")}
        longest = max((one for one in heard if one is not None), default=None)
        outcome.figures[name] = {"refused": refused, "longest_until_heard_s": longest}
    return outcome


def _attack(rover: Standing, attacker: socket.socket, seconds: float, outcome: AttackOutcome) -> bytes:
    """Be a year ahead; and half a day ahead, to be played back once as many as are remembered have spoken.

    Returns what was played back.
    """
    assert rover.key is not None
    near, far = AheadSender(rover.key, DAY / 2, 250), AheadSender(rover.key, 365 * DAY, 251)
    crowd = cycle([AheadSender(rover.key, 0.0, 252, 1 + number) for number in range(MAX_STREAMS)])
    said = [near.weight(_WEIGHT), near.weight(_TAKEN_BACK)]
    for frame in said:
        attacker.send(frame)
        rover.run(0.5)

    def attack() -> bool:
        for frame in (far.beat(), next(crowd).beat(), said[0]):
            attacker.send(frame)
        return True

    watched(rover, outcome, attack, seconds)
    return said[0]


class AheadSender:
    """Signs with the key by a clock that is so many s ahead."""

    def __init__(self, key: SigningKey, ahead: float, system: int, component: int = 1) -> None:
        self._signing = OperatorSigning(key, wall=lambda: time.time() + ahead)
        self._encoder = mavlink.MAVLink(None, system, component)

    def beat(self) -> bytes:
        """Return a heartbeat."""
        return self._signed(mavlink.MAVLink_heartbeat_message(6, 8, 0, 0, 4, 3))

    def weight(self, value: float) -> bytes:
        """Return what sets the weight of sky."""
        return self._signed(mavlink.MAVLink_param_set_message(SYSTEM, COMPONENT_ID, b"AT_W_SKY", value, 9))

    def _signed(self, message: Any) -> bytes:
        return self._signing.sign(bytes(message.pack(self._encoder)), message)


def _station(rover: Standing, component: int) -> tuple[OperatorClient, Runner]:
    """Return one that the companion does not know."""
    assert rover.key is not None
    client, link = OperatorClient(), open_connection("udpout:{}:{}".format(*rover.wire.companion))
    return client, Runner(link, client, 253, component, OperatorSigning(rover.key))


def _heard_after(rover: Standing, station: tuple[OperatorClient, Runner] | None = None) -> float | None:
    """Return the s until its answer is acknowledged; None: it is shut out. station: None: the known one."""
    client, runner = station or (rover.client, None)
    began = time.monotonic()
    sent = client.answer(SYSTEM, Answer(0, Motion.NONE, (SetWord("gravel", 0.5),)), began)
    while not sent.applied and time.monotonic() - began < HEARD_WITHIN:
        rover.step()
        if runner is not None:
            runner.step(time.monotonic())
    return round(time.monotonic() - began, 2) if sent.applied else None


def _weight(rover: Standing) -> float | None:
    memory = read_stored_memory(rover.state)
    return None if memory is None else memory.preferences.get("sky")


def _environment(folder: Path, is_set: bool) -> Mapping[str, str]:
    """Return the variables by which a companion believes that the network set its clock, or did not."""
    told = folder / "synchronized"
    if is_set:
        told.touch()
    (folder / "sitecustomize.py").write_text(_NETWORK_CLOCK.format(path=str(told)), encoding="utf-8")
    return {"PYTHONPATH": f"{folder}:{os.environ.get('PYTHONPATH', '')}".rstrip(":")}
