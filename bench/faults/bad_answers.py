"""Parameters and words that nobody should send, by every door, to a daemon in virtual time."""

from __future__ import annotations

import logging
import math
import struct
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from functools import partial
from pathlib import Path
from random import Random
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from anytraverse.operations import SetWord, Tap
from anytraverse.preferences import Preferences
from bench.faults.row import RowOutcome, Work
from bench.link.lossy import STEP, Radio
from bench.link.radio_model import LinkConditions
from bench.link.rover import Rover
from bench.virtual_time import Clock, virtual_time
from companion.wire.answers import Answer
from companion.wire.ids import (
    ANSWER_COMMAND,
    COMPONENT_ID,
    TUNNEL_ACKNOWLEDGEMENT,
    TUNNEL_ANSWER,
    Motion,
    Result,
)
from companion.wire.parameters import ANSWER, Parameter, build

GROUND = 255, 190
_NAN, _INF = math.nan, math.inf
_NUMBERS = (_NAN, _INF, -_INF, 1e38, -1e38, 3.4e38, 1e-40)
_WORDS = ("", " ", "\0", "a" * 49, "a" * 96, "a\nb", "a\x1b[31mb", "\u202eabc", "a\u200db", "a:b", "a;b")
"""Words that are refused."""
_ODD_WORDS = ("\u05e7\u05d9\u05e8", "\U0001f69c", "\u00e0\u00e9", "b" * 48, "  Two   Words ")
"""Words that look odd and are good."""
_WORD_LISTS = (
    *("", ";;;", ":", ": 1", "grass", "grass:", "grass: nan", "grass: inf", "grass: 1e999", "grass: 2"),
    *("grass: \uff11", "grass: 1_0", "grass: 1; grass: -1", "grass: 1; \0: 1", "\u202egrass: 1", "\ufffe: 1"),
    "; ".join(f"w{number}: 1" for number in range(17)),
    "grass: 0x1",
    "x" * 128,
)
_TEXTS = (
    b"",
    b"C1 go",
    b"\xff\xfe\x00\x01" * 12,
    "\u202e\U0001f69c HOLD".encode(),
    b"HOLD: " + b"a" * 44,
    b"%s%n%d",
)
_REPLIES = ("PARAM_VALUE", "PARAM_EXT_ACK", "COMMAND_ACK")
_SETTLE = 12
"""Turns that pass after each input: more than requests of one sender may come apart."""


class Errors(logging.Handler):
    """Collects what is logged with a traceback: an error that nobody foresaw."""

    def __init__(self) -> None:
        super().__init__()
        self.lines: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        if record.exc_info:
            self.lines.append(f"{record.getMessage()}: {record.exc_info[1]!r}")


class _Ground:
    """Sends anything to a daemon in virtual time. The rover stands before an unknown thing, with a call."""

    def __init__(self, folder: Path, seed: int, clock: Clock) -> None:
        self._clock = clock
        self._radio = Radio(LinkConditions(), str(seed))
        self.rover = Rover(folder, lambda: self._radio.near)
        self._parser = mavlink.MAVLink(None)
        self._parser.robust_parsing = True
        self.echoes: dict[str, float] = {}
        self.beats = self.replies = 0
        """Heartbeats, and replies to whoever asked, since the start."""
        self._encoders: dict[tuple[int, int], Any] = {}
        self._wait("a good view", lambda: self.rover.clear)
        self.rover.shows = 1
        self._wait("a call", lambda: self.rover.calls.call is not None)
        self.call = self.rover.calls.current_id

    def send(self, message: Any, sender: tuple[int, int] = GROUND) -> None:
        """Send a message and let a moment pass."""
        encoder = self._encoders.setdefault(sender, mavlink.MAVLink(None, *sender))
        frame = bytes(message.pack(encoder))
        encoder.seq = (encoder.seq + 1) % 256
        self._radio.write(frame)
        self.turn(_SETTLE)

    def send_answer(self, payload: bytes, sender: tuple[int, int] = GROUND) -> None:
        """Send an answer's payload, of at most 128 bytes."""
        padded = list(payload.ljust(128, b"\0"))
        self.send(
            mavlink.MAVLink_tunnel_message(1, COMPONENT_ID, TUNNEL_ANSWER, len(payload), padded), sender
        )

    def turn(self, times: int) -> None:
        """Let some turns of the daemon pass."""
        for _ in range(times):
            self._clock.now += STEP
            self._radio.carry(self._clock.now)
            self.rover.turn()
            self._radio.carry(self._clock.now)
            for message in self._parser.parse_buffer(self._radio.read()) or []:
                if message.get_type() == "PARAM_VALUE":
                    self.echoes[message.param_id] = message.param_value
                self.beats += message.get_type() == "HEARTBEAT"
                self.replies += message.get_type() in _REPLIES or _is_acknowledgement(message)

    def state(self) -> object:
        """Return all that an input might change: words, settings, policy, call and what was answered."""
        calls, words = self.rover.calls, self.rover.vision.memory.preferences
        settings = tuple(self.rover.link.parameters.value(one.name) for one in listed())
        return dict(words), settings, calls.policy, calls.current_id, calls.go_at, len(calls.applied)

    def sound(self) -> str:
        """Say what is wrong with the words in use; "" for nothing."""
        words = self.rover.vision.memory.preferences
        try:
            Preferences.of(dict(words))
        except ValueError as error:
            return f"words in use: {dict(words)}: {error}"
        return ""

    def _wait(self, what: str, fits: Callable[[], bool]) -> None:
        for _ in range(2000):
            if fits():
                return
            self.turn(1)
        raise RuntimeError(f"{what} never came")


def _is_acknowledgement(message: Any) -> bool:
    return bool(message.get_type() == "TUNNEL" and message.payload_type == TUNNEL_ACKNOWLEDGEMENT)


def listed() -> tuple[Parameter, ...]:
    """The parameters of the companion in `Rover`."""
    return build(["grass"], {"grass": 1.0}, {})


@contextmanager
def ground(work: Work) -> Iterator[tuple[_Ground, Errors]]:
    """A daemon with an open call, and what it logs with a traceback meanwhile."""
    errors, root = Errors(), logging.getLogger()
    root.addHandler(errors)
    try:
        with virtual_time() as clock:
            made = _Ground(work.folder, work.seed, clock)
            try:
                yield made, errors
            finally:
                made.rover.close()
    finally:
        root.removeHandler(errors)


def _unchanged(made: _Ground, what: str, send: Callable[[], None], wrong: list[str]) -> None:
    """Send something that must change nothing."""
    before = made.state()
    send()
    if made.state() != before:
        wrong.append(f"{what} changed {before} to {made.state()}")


def parameters(work: Work) -> RowOutcome:
    wrong, runs = list[str](), 0
    with ground(work) as (made, errors):
        chance = Random(work.seed)
        rows = chance.sample(listed(), 4) if work.short else listed()
        for row in rows:
            bad = [*_NUMBERS[:3], 1e38, row.maximum + 1.0, row.minimum - 0.6, *([0.5] if row.whole else [])]
            bad = [value for value in bad if not row.accepts(value) or row.read_only]
            for value in bad:
                runs += 1
                message = mavlink.MAVLink_param_set_message(
                    1, COMPONENT_ID, row.name.encode(), value, chance.choice((9, 0, 6, 10, 255))
                )
                made.echoes.clear()
                _unchanged(made, f"{row.name} = {value}", partial(made.send, message), wrong)
                if not math.isfinite(made.echoes.get(row.name, _NAN)):
                    wrong.append(f"{row.name} = {value} was echoed as {made.echoes.get(row.name)}")
        call = made.call
        codes = (*_NUMBERS, -1.0, 0.5, 7.0, call * 10.0, call * 10.0 + 7, call * 10 + 11.0, 655353.0)
        for value in codes:
            runs += 1
            message = mavlink.MAVLink_param_set_message(1, COMPONENT_ID, ANSWER.encode(), value, 9)
            _unchanged(made, f"AT_ANSWER = {value}", partial(made.send, message), wrong)
        for name in (b"", b"AT_", b"AT_W_NOTHING", b"\xff\xfe\x01", b"SYSID_THISMAV", b"A" * 16):
            runs += 1
            message = mavlink.MAVLink_param_set_message(1, COMPONENT_ID, name, 0.25, 9)
            _unchanged(made, f"{name!r} = 0.25", partial(made.send, message), wrong)
        wrong += [*errors.lines, *_answers_still(made), *_replied(made, runs // 2)]
    return RowOutcome(runs, tuple(wrong), saw=f"{made.replies} replies; a good answer counts")


def _answers_still(made: _Ground) -> list[str]:
    """Check that a good answer is taken as ever, and that the companion was heard all the time."""
    made.turn(100)
    made.send_answer(Answer(made.call, Motion.GO, (SetWord("thing 1", 1.0),), 77).pack())
    made.turn(100)
    results = [one.result for one in made.rover.calls.applied]
    if Result.APPLIED not in results or made.beats < 3:
        return [f"a good answer afterwards: {results}, {made.beats} heartbeats"]
    return []


def _replied(made: _Ground, least: int) -> list[str]:
    """Check that what was sent came as far as to be refused with a reply, and was not just dropped."""
    return [] if made.replies >= least else [f"only {made.replies} replies"]


def words(work: Work) -> RowOutcome:
    wrong, runs = list[str](), 0
    with ground(work) as (made, errors):
        for what, send in _bad_answers(made, work):
            runs += 1
            _unchanged(made, what, send, wrong)
        for number, word in enumerate(_ODD_WORDS):
            runs += 1
            made.send_answer(Answer(0, Motion.NONE, (SetWord(word, 0.5),), 500 + number).pack())
            if made.sound() or not any(abs(weight - 0.5) < 1e-3 for weight in _words(made).values()):
                wrong.append(f"{word!r} was not taken: {made.sound()}")
        for number in range(20):
            runs += 1
            made.send_answer(Answer(0, Motion.NONE, (SetWord(f"w{number}", 0.1),), 600 + number).pack())
        if made.sound() or len(_words(made)) != 16:
            wrong.append(f"after 20 more words there are {len(_words(made))}: {made.sound()}")
        wrong += [*errors.lines, *_answers_still(made), *_replied(made, runs // 2)]
    return RowOutcome(runs, tuple(wrong), saw=f"{made.replies} replies; a good answer counts")


def _words(made: _Ground) -> dict[str, float]:
    return dict(made.rover.vision.memory.preferences)


def _bad_answers(made: _Ground, work: Work) -> Iterator[tuple[str, Callable[[], None]]]:
    """Yield what an operator should not send, by every door: a name of it, and how it is sent."""
    call, chance = made.call, Random(work.seed)
    found: list[tuple[str, Callable[[], None]]] = []
    number = 100

    def tunnel(what: str, payload: bytes) -> None:
        found.append((f"tunnel: {what}", lambda: made.send_answer(payload)))

    def message(what: str, sent: Any, sender: tuple[int, int] = GROUND) -> None:
        found.append((what, lambda: made.send(sent, sender)))

    for word in _WORDS:
        number += 1
        tunnel(f"word {word!r}", _packed(number, call, word.encode(), 10_000))
        tunnel(f"word {word!r} by a tap", _tapped(number + 1000, call, word))
    for raw in (-32_768, -10_001, 10_001, 32_767):
        number += 1
        tunnel(f"weight {raw}", _packed(number, call, b"drum", raw))
    for torn in (b"\xff\xfe", b"\xed\xa0\x80", b"\xc0\x80", b"dr\0um"):
        number += 1
        tunnel(f"word of bytes {torn!r}", _packed(number, call, torn, 10_000))
    whole = Answer(call, Motion.GO, (SetWord("drum", 1.0),), 900).pack()
    for cut in range(0, len(whole) - 1, 3):
        tunnel(f"an answer of {cut} bytes", whole[:cut])
    tunnel("an answer with a tail", whole + b"\x07rest")
    tunnel("another version", bytes([whole[0] + 1]) + whole[1:])
    for first in (*_NUMBERS, -1.0, 0.5, 65_536.0, call + 1.0):
        sent = mavlink.MAVLink_command_long_message(
            1, COMPONENT_ID, ANSWER_COMMAND, 0, first, 1, 0, 0, 0, 0, 0
        )
        message(f"command for call {first}", sent)
    for motion in (*_NUMBERS, 0.0, 1.5, -1.0, 6.0, 99.0):
        sent = mavlink.MAVLink_command_long_message(
            1, COMPONENT_ID, ANSWER_COMMAND, 0, call, motion, 0, 0, 0, 0, 0
        )
        message(f"command {motion}", sent)
    for index, weight in (
        *((5.0, one) for one in (*_NUMBERS[:6], 1.01, -1.5)),
        (_NAN, 0.5),
        (-1.0, 0.5),
        (999.0, 0.5),
    ):
        sent = mavlink.MAVLink_command_long_message(
            1, COMPONENT_ID, ANSWER_COMMAND, 0, 0, 4, index, weight, 0, 0, 0
        )
        message(f"command: weight {weight} of parameter {index}", sent)
    for text in _WORD_LISTS:
        sent = mavlink.MAVLink_param_ext_set_message(1, COMPONENT_ID, b"AT_WORDS", text.encode()[:128], 11)
        message(f"AT_WORDS = {text[:30]!r}", sent)
    for said in _TEXTS:
        for sender in (GROUND, (1, 1), (7, 1), (1, 42)):
            message(
                f"text {said[:20]!r} of {sender}", mavlink.MAVLink_statustext_message(1, said[:50]), sender
            )
    yield from chance.sample(found, 25) if work.short else found


def _packed(transaction: int, call: int, word: bytes, weight: int) -> bytes:
    """An answer with go and one word, byte by byte, as no client of ours would pack it."""
    empty = Answer(call, Motion.GO, transaction=transaction).pack()
    return empty + struct.pack("<BhB", 1, weight, len(word)) + word


def _tapped(transaction: int, call: int, word: str) -> bytes:
    tap = Tap(1, (0.1, 0.2, 0.3, 0.4), "x", 1.0)
    packed = Answer(call, Motion.GO, (tap,), transaction).pack()
    return packed[:-2] + bytes([len(word.encode())]) + word.encode()
