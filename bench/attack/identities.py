"""Speaks in the names of autopilot and operator without their key, and plays back what they said."""

from __future__ import annotations

import contextlib
import socket
from pathlib import Path

from pymavlink.dialects.v20 import development as mavlink

from anytraverse.operations import SetWord
from bench.attack.outcome import AttackOutcome, watched
from bench.faults.standing import Standing
from bench.faults.standing_wire import HOLD, SYSTEM
from bench.link.frame import framed
from companion.sim.demo.rehearsal import free_port
from companion.storage.journal_copy import read_stored_memory
from companion.wire.ids import COMPONENT_ID, Motion

_LINK = 'unsigned_autopilot = true\n[link.more.radio]\nurl = "udpin:127.0.0.1:{port}"\n'
_OPERATOR = 255, 190
SECONDS, QUICK = 20.0, 6.0


def identities(folder: Path, *, quick: bool) -> AttackOutcome:
    """Attack on the first connection, and on a second one, where an autopilot needs the key."""
    outcome, port = AttackOutcome(), free_port()
    with (
        Standing(folder, policy="hold", signs=True, listens=True, link=_LINK.format(port=port)) as rover,
        socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as attacker,
    ):
        attacker.bind(("127.0.0.1", 0))
        attacker.settimeout(0)
        rover.start()
        rover.wire.recording = True
        rover.answer(0, Motion.NONE, [SetWord("gravel", 0.5)])
        rover.wire.recording = False
        rover.answer(0, Motion.NONE, [SetWord("gravel", -1.0)])
        call = rover.open_call()
        rover.wait("the hold", lambda: rover.wire.mode == HOLD, 20.0)
        refused = _refused(rover)
        forged = [*_forged(call.id), *rover.wire.recorded]
        count = 0

        def attack() -> bool:
            nonlocal count
            for there in (("127.0.0.1", port), rover.wire.companion):
                # On the first wire an autopilot without a key is believed: its telemetry is no attack.
                for frame in forged if there[1] == port else forged[1:]:
                    attacker.sendto(frame, there)
                    count += 1
            return True

        seconds = QUICK if quick else SECONDS
        watched(rover, outcome, attack, seconds / 2)
        rover.wire.reboots = True  # whoever speaks in its name now might become the vehicle
        watched(rover, outcome, attack, seconds / 2 + 5.0)
        outcome.figures = {"forged": count, "refused": _refused(rover) - refused}
        outcome.reached += _commands(attacker)
        memory = read_stored_memory(rover.state)
        if memory is None or memory.preferences.get("gravel") != -1.0:
            outcome.reached.append("an answer that was played back counted")
        if rover.wire.mode != HOLD:
            outcome.reached.append("a go without the key drove on")
    return outcome


def _refused(rover: Standing) -> int:
    rejected = rover.status().get("link", {}).get("rejected", {})
    return sum(rejected.get(why, 0) for why in ("unsigned", "signature", "replay"))


def _forged(call: int) -> list[bytes]:
    """Return frames without a key: the autopilot's, armed in AUTO; a go, a stay, a policy and a weight."""
    beat = mavlink.MAVLink_heartbeat_message(10, 3, 0x81, 10, 4, 3)
    said = [(beat, (SYSTEM, 1))]
    for motion, value in ((Motion.GO, 0), (Motion.STAY, 0), (5, 0)):
        command = mavlink.MAVLink_command_long_message(
            SYSTEM, COMPONENT_ID, 31010, 0, call, float(motion), value, 0, 0, 0, 0
        )
        said.append((command, _OPERATOR))
    weight = mavlink.MAVLink_param_set_message(SYSTEM, COMPONENT_ID, b"AT_W_GRASS", -1.0, 9)
    said.append((weight, _OPERATOR))
    return [framed(message, *sender) for message, sender in said]


def _commands(attacker: socket.socket) -> list[str]:
    """Return what the companion sent to the attacker as to its autopilot."""
    found, parser = list[str](), mavlink.MAVLink(None)
    parser.robust_parsing = True
    with contextlib.suppress(BlockingIOError):
        while True:
            for message in parser.parse_buffer(attacker.recv(4096)) or []:
                if message.get_type() in ("COMMAND_LONG", "SET_MODE", "SET_POSITION_TARGET_LOCAL_NED"):
                    found.append(f"{message.get_type()} to the attacker")
    return found
