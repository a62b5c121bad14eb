"""Parses and formats an answer as an operator types it: changes, then a motion. Pure.

Changes are separated by `;`: `bush: -1`, `tap drum -1`, `tap drum -1 0.40 0.55 0.60 0.80`, `forget bush`,
`forget call 7`, `new episode`, `other place`, `other place 7`. The motion is one of `MOTIONS`.
"""

from __future__ import annotations

import re
from dataclasses import replace

from anytraverse.operations import ForgetCall, ForgetWord, NewEpisode, Operation, OtherPlace, SetWord, Tap
from anytraverse.preferences import check_weight, clean_word
from companion.wire.answers import Answer, AnyOperation
from companion.wire.call_report import CallReport
from companion.wire.ids import Motion
from companion.wire.packing import Fractions
from companion.wire.words_text import operation_text

MOTIONS = {
    "go": Motion.GO,
    "ok": Motion.GO,
    "stay": Motion.STAY,
    "look": Motion.LOOK_AGAIN,
    "look again": Motion.LOOK_AGAIN,
}
_TYPED = {Motion.NONE: "", Motion.GO: "go", Motion.STAY: "stay", Motion.LOOK_AGAIN: "look"}
NO_FRAME = 0
NO_BOX = (0.0, 0.0, 0.0, 0.0)
"""Frame and box of a tap as it is typed, `tap drum -1`, until `placed` finds them. No rover takes the box."""
_NUMBER = re.compile(r"[+-]?(\d+\.?\d*|\.\d+)\Z", re.ASCII)
_MOTION = "|".join(motion.replace(" ", r"\s+") for motion in sorted(MOTIONS, key=len, reverse=True))
_ENDS_WITH_MOTION = re.compile(rf"(.*[^\s,])[\s,]+({_MOTION})\s*\Z", re.IGNORECASE | re.DOTALL)
_TAP = re.compile(r"tap\s+(.*)", re.IGNORECASE)
_FORGET_CALL = re.compile(r"forget\s+call\s+[ch]?(\d{1,5})\Z", re.ASCII | re.IGNORECASE)
_FORGET = re.compile(r"forget\s+(.*)", re.IGNORECASE)
_ORDER = re.compile(rf"({_MOTION}|forget|set|answer|policy|rover)\s+\S", re.IGNORECASE)
_OTHER_PLACE = re.compile(
    r"(?:other|not\s+(?:the|that)(?:\s+same)?)\s+place(?:\s+[ch]?(\d{1,5}))?\Z", re.ASCII | re.IGNORECASE
)
_NEW_EPISODE = re.compile(r"new\s+episode\Z", re.IGNORECASE)


class CommandError(ValueError):
    """Reports a line that is not a command; its text, one line, says why and gives an example."""


class WeightMissingError(CommandError):
    """Reports a word without a weight. word: as it was typed."""

    def __init__(self, word: str, example: str = "bush: -1") -> None:
        super().__init__(
            f'"{word[:40]}" is no command (type `help`), and a word needs its weight: write it as `{example}`'
        )
        self.word = word


def in_range(name: str, value: int, low: int, high: int) -> int:
    """Return `value`. Raises CommandError where it is not in low..high."""
    if not low <= value <= high:
        raise CommandError(f"{name} {value} cannot be: {low} to {high}")
    return value


def read_typed(text: str, target: int = 0) -> Answer:
    """Parse an answer. Without a motion it is words alone: Motion.NONE. Taps have `NO_FRAME`.

    Raises CommandError.
    """
    motion, rest = _trailing_motion(text)
    return Answer(target, motion, _changes(rest))


def typed(answer: Answer) -> str:
    """Format an answer as an operator types it. Raises CommandError for one that would be read otherwise."""
    changes = "; ".join(map(operation_text, answer.operations))
    line = ", ".join(filter(None, (changes, _TYPED[answer.motion])))
    meant = tuple(
        replace(one, frame_id=NO_FRAME) if isinstance(one, Tap) else one for one in answer.operations
    )
    try:
        if read_typed(line, answer.target) == replace(answer, operations=meant):
            return line
    except CommandError:
        pass
    raise CommandError(f'"{line[:40]}" would be read otherwise: use another word')


def placed(answer: Answer, call: CallReport | None) -> Answer:
    """Return a typed answer with its taps in the call's frame: in their boxes, or in the worst tile.

    call: what it answers, None where that is not known. Raises CommandError for a tap without a place.
    """
    return replace(answer, operations=tuple(_placed(one, call) for one in answer.operations))


def _placed(operation: AnyOperation, call: CallReport | None) -> AnyOperation:
    if not isinstance(operation, Tap):
        return operation
    if call is None:
        raise CommandError(
            f"no call is open, so there is no picture to tap; a word works: `{operation.word}: -1`"
        )
    box = operation.box if operation.box != NO_BOX else call.worst_tile_box
    if box is None:
        raise CommandError(
            f"call {call.id} points at no place: give the box, `tap {operation.word} -1 0.4 0.5 0.6 0.8`"
        )
    return replace(operation, frame_id=call.frame_id, box=box)


def _trailing_motion(rest: str) -> tuple[Motion, str]:
    alone = MOTIONS.get(" ".join(rest.lower().split()))
    if alone is not None:
        return alone, ""
    found = _ENDS_WITH_MOTION.match(rest)
    if found is None:
        return Motion.NONE, rest
    return MOTIONS[" ".join(found[2].lower().split())], found[1]


def _changes(rest: str) -> tuple[Operation, ...]:
    segments = [segment.strip() for segment in rest.split(";")]
    if not segments[-1]:
        segments.pop()
    changes = tuple(_change(segment) for segment in segments)
    words = [change.word for change in changes if isinstance(change, SetWord | Tap | ForgetWord)]
    twice = next((word for word in words if words.count(word) > 1), None)
    if twice is not None:
        raise CommandError(f'"{twice}" stands twice: keep one')
    return changes


def _change(segment: str) -> Operation:
    if _NEW_EPISODE.match(segment):
        return NewEpisode()
    if found := _OTHER_PLACE.match(segment):
        return OtherPlace(0 if found[1] is None else in_range("call", int(found[1]), 1, 0xFFFF))
    if found := _FORGET_CALL.match(segment):
        return ForgetCall(in_range("call", int(found[1]), 1, 0xFFFF))
    if segment.lower() == "forget call":
        raise CommandError("which call? Write it as `forget call 7`")
    name, colon, number = segment.rpartition(":")
    if found := _TAP.match(segment):
        return _tap(found[1])
    if colon:
        return SetWord(_new_word(name), _weight(name, number))
    if found := _FORGET.match(segment):
        return ForgetWord(_word(found[1]))
    if not segment:
        raise CommandError("nothing between two `;`: write it as `bush: -1; grass: 1`")
    raise WeightMissingError(segment)


def _tap(rest: str) -> Tap:
    name, colon, figures = rest.rpartition(":")
    numbers = figures.split()
    if not colon:
        tokens = rest.split()
        words = len(tokens)
        while words and _NUMBER.match(tokens[words - 1]):
            words -= 1
        name, numbers = " ".join(tokens[:words]), tokens[words:]
    if len(numbers) not in (1, 5) or not all(map(_NUMBER.match, numbers)):
        raise CommandError(
            f'"tap {rest[:40]}": write it as `tap drum -1` or `tap drum -1 0.40 0.55 0.60 0.80`'
            " (left top right bottom)"
        )
    box = _box([float(number) for number in numbers[1:]]) if len(numbers) == 5 else NO_BOX
    return Tap(NO_FRAME, box, _word(name), _weight(name, numbers[0]))


def _box(sides: list[float]) -> Fractions:
    left, top, right, bottom = (round(side, 4) for side in sides)  # as fine as it is sent
    if not (0 <= left < right <= 1 and 0 <= top < bottom <= 1):
        raise CommandError("a box is left top right bottom in fractions of the picture: 0.40 0.55 0.60 0.80")
    return left, top, right, bottom


def _new_word(raw: str) -> str:
    """Check a word to set. Raises CommandError for "go bush", typed in haste as `go bush: -1`."""
    if found := _ORDER.match(raw.strip()):
        raise CommandError(
            f'"{found[1]}" does not begin a word: write it as `bush: -1`, `bush: -1, go` or `forget bush`'
        )
    return _word(raw)


def _word(raw: str) -> str:
    try:
        return clean_word(raw)
    except ValueError as error:
        raise CommandError(str(error)) from error


def _weight(name: str, number: str) -> float:
    number = number.strip()
    if not _NUMBER.match(number):
        raise CommandError(f'"{number[:20]}" is not a weight: write it as `{name.strip()[:20]}: -1`')
    try:
        return check_weight(name.strip(), float(number))
    except ValueError as error:
        raise CommandError(str(error)) from error
