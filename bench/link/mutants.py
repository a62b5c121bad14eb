"""Makes frames with a right checksum that are wrong in some other way: seeded, 10 us each."""

from __future__ import annotations

import struct
from random import Random
from typing import Any, Literal

from pymavlink.dialects.v20 import development as mavlink
from pymavlink.generator.mavcrc import x25crc

from anytraverse.operations import ForgetWord, NewEpisode, SetWord, Tap
from companion.wire.answers import Answer
from companion.wire.ftp import FtpPayload, Opcode
from companion.wire.ids import ANSWER_COMMAND, CAMERA_COMPONENT_ID, COMPONENT_ID, TUNNEL_ANSWER, Motion

Crowd = Literal["strangers", "all"]
OURS = 1
"""System id of the vehicle to which the link listens."""
ALLOWED = (245, 255)
_LONGEST = 255
_FLOATS = (float("nan"), float("inf"), -float("inf"), 1e38, 1e-40, -2.0, 0.5, 2.0**31, 655353.0)
_COMMANDS = (ANSWER_COMMAND, 176, 245, 400, 510, 511, 512, 520, 0, 65535)
_TEXT = b"\xff\xfegrass\0: 1; old wall: -0.5"


class Mutants:
    """Makes mutated frames; strangers are neither our autopilot nor senders that may change anything."""

    def __init__(self, seed: int) -> None:
        self._random = Random(seed)
        self._templates = [(one.get_msgId(), _payload(one)) for one in _templates()]
        self._sequence = 0

    def next(self, crowd: Crowd) -> bytes:
        """Makes a mutated frame with a right checksum."""
        random = self._random
        number, payload = random.choice(self._templates)
        payload = self._mutated(payload)
        if random.random() < 0.05:
            number = random.choice((random.choice(_IDS), random.randrange(1 << 24)))
        system, component = self._sender(crowd)
        self._sequence = (self._sequence + 1) & 0xFF
        if number < 256 and random.random() < 0.25:
            head = bytes((len(payload), self._sequence, system, component, number))
            return _closed(b"\xfe", head, payload, number)
        if random.random() < 0.5:
            payload = payload.rstrip(b"\0") or b"\0"
        signed = random.random() < 0.1
        head = bytes((len(payload), signed, random.randrange(256), self._sequence, system, component))
        frame = _closed(b"\xfd", head + number.to_bytes(3, "little"), payload, number)
        return frame + random.randbytes(13) if signed else frame

    def _sender(self, crowd: Crowd) -> tuple[int, int]:
        random = self._random
        if crowd == "strangers" or random.random() < 0.2:
            system = random.choice((0, OURS, random.randrange(2, ALLOWED[0])))
            component = random.choice((0, 1, 190, COMPONENT_ID, random.randrange(256)))
            if system == OURS and component in (1, COMPONENT_ID):
                component = 2
            return system, component
        if random.random() < 0.2:
            return OURS, 1
        if random.random() < 0.0005:
            return OURS, COMPONENT_ID
        return random.randint(*ALLOWED), random.choice((1, 190, 230, COMPONENT_ID))

    def _mutated(self, payload: bytes) -> bytes:
        random = self._random
        how = random.randrange(8)
        if how == 0:
            return payload
        if how == 1:
            return payload[: random.randrange(1, len(payload) + 1)]
        if how == 2:
            return payload + random.randbytes(random.randrange(_LONGEST - len(payload) + 1))
        if how == 3:
            return random.randbytes(random.randrange(1, _LONGEST + 1))
        bent = bytearray(payload)
        at = random.randrange(len(bent))
        if how == 4:
            struct.pack_into("<f", bent := bent.ljust(at + 4, b"\0"), at, random.choice(_FLOATS))
        elif how == 5:
            run = random.randrange(1, 9)
            bent[at : at + run] = random.choice((b"\0", b"\xff", b"\x7f", b"\x80")) * len(bent[at : at + run])
        else:
            for _ in range(random.randrange(1, 5)):
                bent[random.randrange(len(bent))] = random.randrange(256)
        return bytes(bent[:_LONGEST])


def genuine(number: int) -> bytes:
    """Makes an unchanged frame from the autopilot or a ground station, each kind in turn."""
    message = _GENUINE[number % len(_GENUINE)]
    ours = not hasattr(message, "target_system") or message.get_type() == "COMMAND_ACK"
    encoder = mavlink.MAVLink(None, *((OURS, 1) if ours else (ALLOWED[1], 190)))
    encoder.seq = number % 256
    return bytes(message.pack(encoder))


def _payload(message: Any) -> bytes:
    """Returns a message's whole payload, with the zeros that MAVLink 2 leaves out."""
    packed = message.pack(mavlink.MAVLink(None, 255, 190))
    return bytes(packed[10:-2]).ljust(message.unpacker.size, b"\0")


def _closed(marker: bytes, head: bytes, payload: bytes, number: int) -> bytes:
    known = mavlink.mavlink_map.get(number)
    checksum = x25crc(head + payload + bytes((known.crc_extra if known is not None else 0,)))
    return marker + head + payload + struct.pack("<H", checksum.crc)


_IDS = tuple(mavlink.mavlink_map)


def _templates() -> list[Any]:
    """Makes a message of every kind to which the link reacts, right in every field."""
    system, to, camera = OURS, COMPONENT_ID, CAMERA_COMPONENT_ID
    files = (
        FtpPayload(3, 1, Opcode.OPEN_FILE_RO, 11, data=b"/state.json"),
        FtpPayload(4, 1, Opcode.BURST_READ_FILE, 80),
        FtpPayload(5, 1, Opcode.READ_FILE, 80, offset=80),
        FtpPayload(6, 0, Opcode.LIST_DIRECTORY, 1, data=b"/"),
        FtpPayload(7, 1, Opcode.TERMINATE_SESSION, 0),
        FtpPayload(8, 0, Opcode.CALC_FILE_CRC32, 11, data=b"/state.json"),
    )
    answers = (
        Answer(1, Motion.GO, transaction=7),
        Answer(1, Motion.NONE, (SetWord("drum", -1.0), ForgetWord("grass")), 8),
        Answer(1, Motion.NONE, (Tap(3, (0.1, 0.2, 0.3, 0.4), "drum", -1.0), NewEpisode()), 9),
    )
    long = Answer(1, Motion.STAY, (NewEpisode(),), 10)
    payloads = [*(answer.pack() for answer in answers), long.pack(0, 2), long.pack(1, 2)]
    return [
        mavlink.MAVLink_param_request_list_message(system, to),
        mavlink.MAVLink_param_request_read_message(system, to, b"", 3),
        *(
            mavlink.MAVLink_param_set_message(system, to, name, value, 9)
            for name, value in ((b"AT_W_GRASS", 0.5), (b"AT_ANSWER", 11.0), (b"AT_THR_ROI", 0.4))
        ),
        mavlink.MAVLink_param_ext_request_list_message(system, to),
        mavlink.MAVLink_param_ext_request_read_message(system, to, b"AT_WORDS", -1),
        *(
            mavlink.MAVLink_param_ext_set_message(system, to, b"AT_WORDS", text, 11)
            for text in (b"grass: 0.5; drum: -1", _TEXT)
        ),
        *(
            mavlink.MAVLink_command_long_message(system, to, command, 0, 1, 4, 10, 0.5, 0, 0, 0)
            for command in _COMMANDS
        ),
        mavlink.MAVLink_command_long_message(system, to, ANSWER_COMMAND, 1, 1, 1, 0, 0, 0, 0, 0),
        mavlink.MAVLink_command_long_message(system, to, 245, 0, 2, 0, 0, 0, 0, 0, 0),
        mavlink.MAVLink_command_long_message(system, to, 511, 0, 385, 500_000, 0, 0, 0, 0, 0),
        mavlink.MAVLink_command_long_message(system, to, ANSWER_COMMAND, 0, 0, 5, 1, 0, 0, 0, 0),
        mavlink.MAVLink_command_int_message(system, to, 0, ANSWER_COMMAND, 0, 0, 1, 2, 0, 0, 0, 0, 0),
        mavlink.MAVLink_command_long_message(system, camera, 2004, 1, 0.5, 0.5, 0.1, 0, 0, 0, 0),
        mavlink.MAVLink_command_long_message(system, camera, 2005, 0, 0.4, 0.5, 0.6, 0.7, 0, 0, 0),
        mavlink.MAVLink_command_long_message(system, camera, 511, 0, 275, 500_000, 0, 0, 0, 0, 0),
        mavlink.MAVLink_command_long_message(system, camera, 512, 0, 259, 0, 0, 0, 0, 0, 0),
        *map(_tunnel, payloads),
        *(mavlink.MAVLink_file_transfer_protocol_message(0, system, to, one.pack()) for one in files),
        mavlink.MAVLink_heartbeat_message(10, 3, 129, 10, 4, 3),
        mavlink.MAVLink_system_time_message(1_700_000_000_000_000, 5000),
        mavlink.MAVLink_global_position_int_message(5000, 1, 1, 1, 1, 1, 1, 1, 9000),
        mavlink.MAVLink_attitude_message(5000, 0.1, 0.1, 0.1, 0, 0, 0),
        mavlink.MAVLink_rc_channels_message(5000, 16, *([1500] * 18), 200),
        mavlink.MAVLink_sys_status_message(65536, 65536, 65536, 1, 1, 1, 1, 1, 1, 1, 1, 1, 1),
        mavlink.MAVLink_current_mode_message(1, 10, 10),
        mavlink.MAVLink_command_ack_message(176, 0, 0, 0, system, to),
    ]


def _tunnel(payload: bytes) -> Any:
    padded = payload.ljust(128, b"\0")
    return mavlink.MAVLink_tunnel_message(OURS, COMPONENT_ID, TUNNEL_ANSWER, len(payload), padded)


_GENUINE = _templates()
