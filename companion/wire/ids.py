"""Defines the ids and enums on the wire. A number keeps its meaning: a new meaning gets a new number."""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from enum import IntEnum, IntFlag
from typing import NamedTuple

SenderId = tuple[int, int]
"""System and component id of whoever sent a message."""
PAGE_SENDER: SenderId = (0, 0)
"""Whoever answers on the rover's own page, which has no MAVLink ids."""

COMPONENT_ID = 191
"""MAV_COMP_ID_ONBOARD_COMPUTER."""

AUTOPILOT_COMPONENT_ID = 1

CAMERA_COMPONENT_ID = 100
"""MAV_COMP_ID_CAMERA, of the companion as a camera, unless it is configured."""

ANSWER_COMMAND = 31010
"""MAV_CMD_USER_1: param1 id of the call or hold (0 = the current one), param2 `Motion` or 4."""

MODE_REQUEST_COMMAND = 31014
"""MAV_CMD_USER_5, to the script on the autopilot: set a mode, if the one that stands is the expected one.

param1 id of the hold (0: only answer), param2 expected mode, param3 the mode to set, param4 serial number.
"""

TUNNEL_SUMMARY = 45001
TUNNEL_CALL = 45002
TUNNEL_ANSWER = 45003
TUNNEL_ACKNOWLEDGEMENT = 45004

VERSION = 1
"""Version of all payload layouts; a receiver refuses any other."""

MAX_TEXT = 50
"""Bytes of a STATUSTEXT that every ground station shows in full."""

UNDER_VOLTAGE, CPU_THROTTLED, DISK_FULL = 1, 2, 8
"""COMPUTER_STATUS_FLAGS. A ground station's pymavlink may be too old to know them."""
NO_TEMPERATURE = 127
"""The temperature in ONBOARD_COMPUTER_STATUS that is not known."""

ALERT, ERROR, WARNING, NOTICE, INFO = 1, 3, 4, 5, 6
"""MAV_SEVERITY of texts."""


class State(IntEnum):
    """What the companion is doing, in the summary and in the low byte of its heartbeat's custom_mode."""

    STARTING = 0
    OK = 1
    CALLING = 2
    HOLDING = 3
    BLOCKED = 4
    FAULT = 5
    OFF = 6


class Reasons(IntFlag):
    """Why a frame is not OK."""

    NONE = 0
    UNKNOWN_SCENE = 1
    UNKNOWN_OBJECT = 2
    BLOCKED = 4
    FAULT = 8


class Kind(IntEnum):
    """What an id names: a call for words, or a hold without a call."""

    CALL = 1
    HOLD = 2


class Stage(IntEnum):
    """The stage of a call or hold."""

    OPEN = 1
    """It waits for an answer."""
    ANSWERED = 2
    """Its answer covers its reasons; the hold waits for "go", or for OK frames."""
    CLEAR = 3
    """Its reasons are gone, or are driven round; it asks for a go."""
    CLOSED = 4


class Outcome(IntEnum):
    """How a call or hold was closed."""

    NONE = 0
    ANSWERED = 1
    ACCEPTED = 2
    PASSED = 3
    TAKEN_OVER = 4
    RECOVERED = 5
    SWITCHED_OFF = 6


class Motion(IntEnum):
    """What an answer says about driving. NONE: the words apply, and the hold goes on."""

    NONE = 0
    GO = 1
    STAY = 2
    LOOK_AGAIN = 3


SET_WEIGHT = 4
"""param2 of the answer command: param3 index of the word's parameter, param4 its weight."""

SET_POLICY = 5
"""param2 of the answer command: param3 is a `Policy`; param1 is ignored."""


REFUSE_MATCH = 6
"""param2 of the answer command: refuses the newest match; param1: the call whose place matched, 0: any."""
OTHER_PLACE = 4
"""The same as the last digit of AT_ANSWER."""


class Result(IntEnum):
    """The result of an answer."""

    APPLIED = 0
    APPLIED_NOT_REMEMBERED = 1
    """In force until the next restart: the journal could not be written."""
    NOT_COVERED = 2
    """In force and stored, but the call's frame still has its reason: the call stays open."""
    STALE = 3
    """The id names no open call or hold."""
    REFUSED = 4
    """Nothing was changed; the text says why."""
    DENIED = 5
    """The sender may not answer."""
    BUSY = 6
    """Nothing was changed yet: the sender should send it again."""


CHANGING_RESULTS = frozenset({Result.APPLIED, Result.APPLIED_NOT_REMEMBERED, Result.NOT_COVERED})
"""Results of an answer that was accepted: it changed something."""


class Policy(IntEnum):
    """What the companion may do to the vehicle."""

    REPORT = 0
    SHADOW = 1
    HOLD = 2
    OFF = 3
    GUIDE = 4
    """It holds, and on an ArduPilot rover it drives round what leaves room."""

    @property
    def holds(self) -> bool:
        """Whether it may hold the vehicle."""
        return self in (Policy.HOLD, Policy.GUIDE)


class HeartbeatMode(NamedTuple):
    """The content of the companion's heartbeat. current_id: of the open call or hold, 0 for none.

    fault_accepted: a human drives on in spite of the fault that stands, or the vehicle stands after its
    mission, so that it holds nobody for now. braking: the script on the autopilot brakes for its hold.
    guiding: the companion drives the vehicle in GUIDED, or is about to.
    """

    state: State
    current_id: int
    policy: Policy
    fault_accepted: bool = False
    braking: bool = False
    guiding: bool = False


def heartbeat_mode(
    state: State,
    current_id: int,
    policy: Policy,
    fault_accepted: bool = False,
    braking: bool = False,
    guiding: bool = False,
) -> int:
    """Pack custom_mode of the heartbeat.

    Bits 0-7: state. 8-23: id of the open call or hold. 24-25: policy. 26: the fault is accepted by hand.
    27: it brakes for the hold. 28: it drives in GUIDED. 29: the policy is guide, and 24-25 say hold.
    """
    guide = policy is Policy.GUIDE
    flags = int(fault_accepted) << 26 | int(braking) << 27 | int(guiding) << 28 | int(guide) << 29
    told = Policy.HOLD if guide else policy
    return int(state) | (current_id & 0xFFFF) << 8 | int(told) << 24 | flags


def read_heartbeat_mode(custom_mode: int) -> HeartbeatMode:
    """Unpack a heartbeat's custom_mode.

    Raises ValueError for a state of a later version, and for policy guide where bits 24-25 do not say hold.
    """
    policy = Policy(custom_mode >> 24 & 3)
    if custom_mode >> 29 & 1:
        if policy is not Policy.HOLD:
            raise ValueError(f"policy guide is a kind of hold, and this says {policy.name.lower()}")
        policy = Policy.GUIDE
    return HeartbeatMode(
        State(custom_mode & 0xFF),
        custom_mode >> 8 & 0xFFFF,
        policy,
        bool(custom_mode >> 26 & 1),
        bool(custom_mode >> 27 & 1),
        bool(custom_mode >> 28 & 1),
    )


def words_hash(weights: Mapping[str, float]) -> int:
    """CRC-32 of words and weights (to 1e-4), in any order, by which both ends compare their words."""
    text = ";".join(f"{word}:{round(weight * 10_000)}" for word, weight in sorted(weights.items()))
    return zlib.crc32(text.encode())


def newest_first(numbers: list[int]) -> list[int]:
    """Order ids of 16 bits, which begin again after 65535, by age: the widest gap is before the oldest.

    Files' times may be wrong, since a rover often boots without a clock.
    """
    known = sorted(set(numbers))
    if not known:
        return []
    gaps = [(number - before) & 0xFFFF for before, number in zip([known[-1], *known], known, strict=False)]
    oldest = gaps.index(max(gaps))
    return [*known[oldest:], *known[:oldest]][::-1]
