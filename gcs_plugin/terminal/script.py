"""Answers calls by a table of rules, for demonstrations and tests. Pure: takes calls and the time.

A rule is a JSON object. The first rule that fits a call and has uses left answers it, once it is due:

    answer    the line, as an operator would type it (without rover and id)
    when      the call's stage: "open" (default), "answered" or "clear"
    kind      "call" or "hold"
    reasons   the call must have all of these: "unknown_scene", "unknown_object", "blocked", "fault"
    holding   true or false: whether the call holds the vehicle
    nth       only the n-th call that fits the rest of the rule, from 1
    times     how often the rule may be used; by default without limit
    after     seconds to wait, from when the call reached this stage
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

from companion.wire.answers import Answer
from companion.wire.call_report import CallReport
from companion.wire.ids import Kind, Reasons, Stage
from companion.wire.typed_answers import CommandError
from gcs_plugin.client.rovers import TrackedCall
from gcs_plugin.terminal.commands import parse

EXAMPLE = '[{"reasons": ["unknown_object"], "answer": "tap drum -1 go"}, {"when": "clear", "answer": "go"}]'
MAX_RULES = 200
MAX_WAIT_S = 3600
_STAGES = {"open": Stage.OPEN, "answered": Stage.ANSWERED, "clear": Stage.CLEAR}
_KINDS = {"call": Kind.CALL, "hold": Kind.HOLD}
_REASONS = {reason.name.lower(): reason for reason in Reasons if reason.name}


_Key = tuple[int, int]  # system, serial number of the call


class ScriptError(ValueError):
    """Reports a table that cannot be used; the text names the rule and the remedy."""


@dataclass
class _Rule:
    """Holds one row of the table."""

    answer: str
    when: Stage = Stage.OPEN
    kind: Kind | None = None
    reasons: Reasons = Reasons.NONE
    holding: bool | None = None
    nth: int | None = None
    times: int | None = None
    after: float = 0.0
    used: int = 0
    _fitted: dict[_Key, int] = field(default_factory=dict)

    def fits(self, key: _Key, call: CallReport) -> bool:
        """Return whether the rule fits this call at its stage; also counts the calls that it fits."""
        if (
            call.stage is not self.when
            or (self.kind is not None and call.kind is not self.kind)
            or call.reasons & self.reasons != self.reasons
            or (self.holding is not None and call.holding is not self.holding)
        ):
            return False
        ordinal = self._fitted.setdefault(key, len(self._fitted) + 1)
        return self.nth is None or ordinal == self.nth

    @property
    def changes(self) -> bool:
        """Whether its answer changes words or scenes, so that a sign may turn."""
        _, command = parse(self.answer) or (None, None)
        return isinstance(command, Answer) and bool(command.operations)

    @property
    def left(self) -> bool:
        """Whether it may be used again."""
        return self.times is None or self.used < self.times


@dataclass
class _StageVisit:
    """Holds since when a call is at a stage, and which rules have answered it there."""

    stage: Stage
    since: float
    tried: set[int] = field(default_factory=set)


class Script:
    """Decides which line answers which open call.

    Each rule answers a call once at each stage. So after an answer that did not cover the thing, the next
    rule answers the call.
    """

    def __init__(self, rules: list[_Rule]) -> None:
        self._rules = rules
        self._visits: dict[_Key, _StageVisit] = {}

    @classmethod
    def parse(cls, text: str) -> Script:
        """Read a JSON list of rules. Raises ScriptError."""
        try:
            table = json.loads(text)
        except (ValueError, RecursionError) as error:
            raise ScriptError(f"the script is not JSON ({error}): write it as {EXAMPLE}") from error
        if not isinstance(table, list) or not 0 < len(table) <= MAX_RULES:
            raise ScriptError(f"a script is a list of 1 to {MAX_RULES} rules: {EXAMPLE}")
        return cls([_rule(number, row) for number, row in enumerate(table, 1)])

    def answer(self, system: int, call: TrackedCall, now: float, *, words_read: bool = True) -> str | None:
        """Return the line to type for this open call now, or None.

        words_read: False until the rover's words are known; an answer with words waits for them.
        """
        key, stage = (system, call.serial), call.data.stage
        visit = self._visits.get(key)
        if visit is None or visit.stage is not stage:
            visit = self._visits[key] = _StageVisit(stage, now)
        for number, rule in enumerate(self._rules):
            if not rule.fits(key, call.data) or number in visit.tried or not rule.left:
                continue
            if now - visit.since < rule.after or (rule.changes and not words_read):
                return None
            rule.used += 1
            visit.tried.add(number)
            return rule.answer
        return None


def _rule(number: int, row: Any) -> _Rule:
    known = ("answer", "when", "kind", "reasons", "holding", "nth", "times", "after")
    if not isinstance(row, dict):
        raise ScriptError(f"rule {number} is not an object: write it as {EXAMPLE}")
    unknown = sorted(set(row) - set(known))
    if unknown:
        raise ScriptError(f'rule {number}: "{unknown[0]}" is unknown, it can hold {", ".join(known)}')
    return _Rule(
        answer=_answer(number, row.get("answer")),
        when=_choice(number, "when", row.get("when", "open"), _STAGES),
        kind=None if "kind" not in row else _choice(number, "kind", row["kind"], _KINDS),
        reasons=_reasons(number, row.get("reasons", [])),
        holding=_typed(number, row, "holding", (bool,)),
        nth=_counted(number, row, "nth"),
        times=_counted(number, row, "times"),
        after=_seconds(number, row, "after"),
    )


def _answer(number: int, line: Any) -> str:
    try:
        rover, command = (parse(line) if isinstance(line, str) else None) or (None, None)
    except CommandError as error:
        raise ScriptError(f"rule {number}: {error}") from error
    if rover is not None or not isinstance(command, Answer) or command.target or command.about_files:
        raise ScriptError(f'rule {number}: "answer" is a line without rover and id: "tap drum -1 go"')
    return str(line)


def _choice(number: int, name: str, value: Any, choices: Mapping[str, Any]) -> Any:
    if not isinstance(value, str) or value not in choices:
        raise ScriptError(f'rule {number}: "{name}" is {value!r}, it can be {", ".join(choices)}')
    return choices[value]


def _reasons(number: int, names: Any) -> Reasons:
    if not isinstance(names, list):
        raise ScriptError(f'rule {number}: "reasons" is a list: ["unknown_object"]')
    reasons = Reasons.NONE
    for name in names:
        reasons |= _choice(number, "reasons", name, _REASONS)
    return reasons


def _counted(number: int, row: Mapping[str, Any], name: str) -> int | None:
    value: int | None = _typed(number, row, name, (int,))
    if value is not None and value < 1:
        raise ScriptError(f'rule {number}: "{name}" counts from 1, not {value}')
    return value


def _seconds(number: int, row: Mapping[str, Any], name: str) -> float:
    value = _typed(number, row, name, (int, float))
    if value is not None and not 0 <= value <= MAX_WAIT_S:
        raise ScriptError(f'rule {number}: "{name}" is {value!r}, it can be 0 to {MAX_WAIT_S} seconds')
    return float(value or 0.0)


def _typed(number: int, row: Mapping[str, Any], name: str, kinds: tuple[type, ...]) -> Any:
    value = row.get(name)
    if name not in row:
        return None
    if not isinstance(value, kinds) or (isinstance(value, bool) and bool not in kinds):
        raise ScriptError(
            f'rule {number}: "{name}" is {value!r}, not {" or ".join(k.__name__ for k in kinds)}'
        )
    return value
