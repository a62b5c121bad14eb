"""Reads the autopilot's parameters, proposes what `companion check` wants, and sets one on a click."""

from __future__ import annotations

import math
import re
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from companion.config import Config
from companion.config.link_settings import LinkSettingError
from companion.desk.check.autopilot import (
    LIMIT,
    AutopilotReadings,
    CourseListener,
    await_course,
    judged,
    silence,
    talking,
)
from companion.desk.check.interview import NAMES, Facts, Heartbeat, Interview, names, table_of
from companion.desk.check.rules import CheckFinding, ParameterRule, Verdict
from companion.pages.requests import RequestError

READ_WITHIN = LIMIT + 10.0
"""Seconds in which it is asked."""
SET_WITHIN = 15.0
"""Seconds until a value that was set must have been read back."""
_ARMED_KNOWN_FOR = 3.0
"""Seconds for which it is known whether the vehicle is armed: it says so each second."""
_SAME = 1e-4
_SET, _SUBTRACT = re.compile(r"\bset (\d+(?:\.\d+)?)"), re.compile(r"\bsubtract (\d+)\b")


@dataclass(frozen=True)
class AskedAutopilot:
    """An autopilot that has told its parameters. course: as in `AutopilotReadings`."""

    url: str
    interview: Interview
    autopilot: Heartbeat
    course: str

    def readings(self, config: Config) -> AutopilotReadings:
        """Judge what it told, for a configuration with any policy."""
        return replace(judged(config, self.url, self.interview), course=self.course)

    def facts(self, config: Config) -> Facts:
        """Return what the rules need to know."""
        call = config.call
        offboard, deadman = call.px4_hold == "offboard", call.px4_deadman != "off"
        values, system_id = self.interview.values, self.autopilot.system_id
        return Facts(values, system_id, config.link.allowed_senders, offboard, call.policy, deadman)


def read(config: Config) -> AskedAutopilot:
    """Ask the autopilot for all that `companion check` judges; up to 40 s. Raises RequestError."""
    url = config.link.url
    try:
        with talking(config, url, names) as (interview, turn):
            listener = CourseListener(config.link.system_id)
            interview.listen = listener.hear
            until = interview.began + LIMIT
            while not turn() and time.monotonic() < until:
                pass
            await_course(interview, listener, turn)
    except LinkSettingError as error:
        raise RequestError(str(error)) from error
    if interview.autopilot is None:
        raise RequestError(silence(url, interview))
    return AskedAutopilot(url, interview, interview.autopilot, listener.missing)


def rows(autopilot: int, facts: Facts) -> list[dict[str, Any]]:
    """Return one row a parameter that a rule names: JSON values. proposed: None where nothing is to be set.

    autopilot: HEARTBEAT.autopilot.
    """
    named = dict.fromkeys(rule.name for rule in table_of(autopilot).rules if rule.name in facts.values)
    made = [_row(autopilot, name, facts) for name in named]
    return sorted(made, key=lambda row: (-Verdict[row["verdict"].upper()], row["name"]))


def _row(autopilot: int, name: str, facts: Facts) -> dict[str, Any]:
    bad = sorted(_bad(autopilot, name, facts), key=lambda rule: -rule.verdict)
    return {
        "name": name,
        "value": facts.values[name],
        "verdict": (bad[0].verdict if bad else Verdict.PASS).name.lower(),
        "text": "; ".join(rule.text for rule in bad),
        "proposed": proposed(autopilot, name, facts),
    }


def _bad(autopilot: int, name: str, facts: Facts) -> list[ParameterRule]:
    """Return the rules that call the value of a parameter bad."""
    value = facts.values[name]
    return [rule for rule in table_of(autopilot).rules if rule.name == name and rule.bad(value, facts)]


def proposed(autopilot: int, name: str, facts: Facts) -> float | None:
    """Return a value that a rule asks for in its text and that all rules accept; None without one."""
    for rule in _bad(autopilot, name, facts):
        for wanted in _named(rule.text, facts.values[name]):
            if not _bad(autopilot, name, replace(facts, values={**facts.values, name: wanted})):
                return wanted
    return None


def _named(text: str, value: float) -> Iterator[float]:
    yield from (float(found) for found in _SET.findall(text))
    yield from (float(int(value) & ~int(found)) for found in _SUBTRACT.findall(text))


def set_one(config: Config, seen: AskedAutopilot, name: str, before: float, after: float) -> float:
    """Set a parameter if it still has the value that a person saw. Returns what is read back.

    seen: the autopilot whose value that was: no other one is written to, and none that is armed or does not
    say. before, after: seen, and wanted. Raises RequestError; it then says whether anything was written.
    """
    sent, reads, told = False, math.nan, _Armed()
    try:
        with talking(config, seen.url, lambda _kind: (name,)) as (interview, turn):
            interview.listen = told.hear
            until = time.monotonic() + SET_WITHIN
            while time.monotonic() < until:
                turn()
                now = interview.values.pop(name, None)
                if not sent:
                    _refuse_unseen(interview.autopilot, seen.autopilot, told)
                    if now is not None and not _same(now, before):
                        raise RequestError(
                            f"nothing was written: {name} is {now:g} by now, not {before:g}: read again"
                        )
                    reads = reads if now is None else now
                    if not math.isnan(reads) and told.stands(time.monotonic()):
                        interview.set(name, after, time.monotonic())
                        sent, reads = True, math.nan
                elif now is not None:
                    if _same(now, after):
                        return now
                    if not _same(now, before):
                        raise RequestError(
                            f"the autopilot keeps {name} at {now:g}: set it at the ground station"
                        )
                    reads = now  # on a slow link perhaps the answer to what was asked before
                    interview.expect(name, time.monotonic())
    except LinkSettingError as error:
        raise RequestError(str(error)) from error
    if not sent:
        raise RequestError(
            f"nothing was written: the autopilot did not tell {name} and that it is disarmed"
            f" within {SET_WITHIN:.0f} s"
        )
    if math.isnan(reads):
        raise RequestError(f"{name} = {after:g} was sent, and is not confirmed: read again")
    raise RequestError(
        f"{name} = {after:g} was sent, and reads {reads:g}: read again, or set it at the ground station"
    )


class _Armed:
    """Hears whether the autopilot is armed. armed: what it said at last. heard_at: monotonic seconds."""

    def __init__(self) -> None:
        self.armed, self.heard_at = False, -math.inf

    def hear(self, message: Any, now: float) -> None:
        """Take a message of the autopilot."""
        if message.get_type() == "HEARTBEAT":
            self.armed = bool(message.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED)
            self.heard_at = now

    def stands(self, now: float) -> bool:
        """Whether it has said a moment ago that it is not armed."""
        return not self.armed and now - self.heard_at <= _ARMED_KNOWN_FOR


def _refuse_unseen(found: Heartbeat | None, seen: Heartbeat, told: _Armed) -> None:
    """Raise RequestError for another autopilot than the one that was seen, and for an armed one."""
    if found is not None and found != seen:
        raise RequestError(
            f"nothing was written: system {found.system_id} answers on the link, and what you see is of"
            f" system {seen.system_id}: read again"
        )
    if told.armed:
        raise RequestError("nothing was written: the vehicle is armed: disarm it first")


def _same(one: float, other: float) -> bool:
    return math.isclose(one, other, rel_tol=_SAME, abs_tol=_SAME)


def document(config: Config, found: AskedAutopilot) -> dict[str, Any]:
    """Return what the page shows: JSON values."""
    kind, readings = found.autopilot.kind, found.readings(config)
    own = rows(kind, found.facts(config))
    named = {row["name"] for row in own}
    return {
        "url": found.url,
        "autopilot": NAMES.get(kind) or f"autopilot of kind {kind}",
        "system": found.autopilot.system_id,
        "rows": own,
        "others": [finding.row() for finding in others(readings.findings, named)],
        "speed": readings.speed,
        "course": readings.course,
        "grounds": [f"{system}/{component}" for system, component in readings.grounds],
    }


def others(findings: list[CheckFinding], named: set[str]) -> Iterator[CheckFinding]:
    """Yield the findings that are about no parameter with a value."""
    return (one for one in findings if one.check.split(" ")[0] not in named)
