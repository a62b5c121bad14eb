"""Rows of the fault table: parameters, words, frames and packets that nobody should send."""

from __future__ import annotations

import time
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from anytraverse.operations import SetWord
from bench.faults import bad_answers, mutated_configs
from bench.faults.bad_answers import GROUND
from bench.faults.row import Row, RowOutcome, Work
from bench.faults.standing import Standing, repeating
from bench.faults.standing_wire import AUTO, HOLD
from bench.link.fuzz import Broken, Fuzz
from companion.wire.answers import Answer
from companion.wire.ids import (
    COMPONENT_ID,
    TUNNEL_ANSWER,
    Motion,
    Result,
)
from companion.wire.parameters import BUDGET, POLICY
from companion.wire.signing import SigningKey, Timestamps, ticks


def _malformed(work: Work) -> RowOutcome:
    frames = 4_000 if work.short else 200_000
    try:
        told = Fuzz(work.seed).run(frames)
    except Broken as error:
        return RowOutcome(frames, (str(error),))
    rejected = sum(told.rejected.values())
    return RowOutcome(
        told.frames, saw=f"{rejected} rejected, {told.bad} not readable, memory +{told.blocks} blocks"
    )


def _forged(work: Work) -> RowOutcome:
    """Frames that claim to be the operator's or the autopilot's, to a companion that signs."""
    wrong, sent = list[str](), 0
    with Standing(work.folder, policy="hold", seed=work.seed, signs=True) as rover:
        rover.start()
        first = rover.open_call()
        rover.wait("the hold", lambda: rover.wire.mode == HOLD, 5.0)
        rover.wire.recording = True
        rover.thing = False
        rover.answer(first.id, Motion.GO)
        rover.wait("the way back", lambda: rover.wire.mode == AUTO, 10.0)
        rover.wire.recording = False
        call = rover.open_call(30.0, after=first.id)
        rover.wait("the hold", lambda: rover.wire.mode == HOLD, 5.0)
        rover.run(2.2)
        words = rover.status()["words"]
        forger = Forger(call.id, rover.wire.recorded)
        for number in range(60 if work.short else 3000):
            sent += 1
            rover.wire.write(forger.next(number))
            rover.step()
        rover.run(1.2)
        beat = rover.client.rovers[1]
        if beat.current_id != call.id or rover.wire.mode != HOLD or rover.status()["words"] != words:
            wrong.append(f"call {beat.current_id}, mode {rover.wire.mode}, words {rover.status()['words']}")
        rejected, told = rover.status()["link"]["rejected"], rover.log.count("what the autopilot says")
        if told:
            wrong.append(f"forged frames made {told} lines of the log about the autopilot")
        refused = sum(rejected.get(why, 0) for why in ("unsigned", "signature", "replay"))
        if refused < sent * 0.9:
            wrong.append(f"of {sent} forged frames {refused} were refused: {rejected}")
        rover.thing = False
        given = rover.answer(call.id, Motion.GO)
        if given.result is not Result.APPLIED:
            wrong.append(f"the operator's own go was then {given.result.name}")
        rover.wait("the way back", lambda: rover.wire.mode == AUTO, 10.0)
    counted = ", ".join(f"{count} {why}" for why, count in rejected.items())
    return RowOutcome(sent, tuple(wrong), saw=f"refused and counted: {counted}")


class Forger:
    """Makes frames in others' names: unsigned, with another key, replayed, or with a time far ahead."""

    def __init__(self, call: int, recorded: list[bytes]) -> None:
        """recorded: genuine signed frames that were received before."""
        self._call, self._recorded = call, recorded
        self._key, self._stamps = SigningKey(b"another key of 32 bytes........."), Timestamps()

    def next(self, number: int) -> bytes:
        """Make the next one."""
        if number % 4 == 3 and self._recorded:
            return self._recorded[number // 4 % len(self._recorded)]
        autopilot = number % 3 == 0
        encoder = mavlink.MAVLink(None, *((1, 1) if autopilot else GROUND))
        encoder.seq = number % 256
        message: Any
        if autopilot:
            message = mavlink.MAVLink_heartbeat_message(10, 3, 129, 0 if number % 2 else AUTO, 4, 3)
        elif number % 3 == 1:
            payload = Answer(self._call, Motion.GO, (SetWord("forged", 1.0),), 5000 + number).pack()
            padded = list(payload.ljust(128, b"\0"))
            message = mavlink.MAVLink_tunnel_message(1, COMPONENT_ID, TUNNEL_ANSWER, len(payload), padded)
        else:
            name, value = ((POLICY, 3.0), (BUDGET, 50.0), ("AT_W_GRASS", -1.0))[number // 3 % 3]
            message = mavlink.MAVLink_param_set_message(1, COMPONENT_ID, name.encode(), value, 9)
        frame = bytes(message.pack(encoder))
        if number % 4 == 0:
            return frame
        ahead = 20 * 365 * 86_400.0 if number % 4 == 2 else 0.0
        return self._key.sign(frame, message.crc_extra, 0, ticks(time.time() + ahead) + number)


ROWS = (
    Row(
        "malformed frames",
        "200,000 frames with a right checksum, mutated in all other ways, from everybody",
        "nothing of a stranger counts",
        _malformed,
    ),
    Row(
        "bad parameters",
        "NaN, infinities, values out of range, of other types and for unknown names; rubbish as AT_ANSWER",
        "the old value stays; the call stays open",
        bad_answers.parameters,
    ),
    Row(
        "bad words",
        "empty, long, control, right-to-left and torn words, weights out of range, by tunnel, command, "
        "parameter and text",
        "refused; the call stays open",
        bad_answers.words,
    ),
    repeating(
        "forged packets",
        "3000 answers, heartbeats and settings in others' names: unsigned, another key, replayed, far ahead",
        "none counts; the operator's own does",
        1,
        _forged,
        returns=False,
    ),
    *mutated_configs.ROWS,
)
"""Of what comes in."""
