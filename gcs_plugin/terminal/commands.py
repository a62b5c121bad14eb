"""Parses what an operator types into a command. Pure: it knows words, not rovers.

    [rover N] [call id] [changes] [go | stay | look]
    [rover N] policy report | shadow | hold | guide | off
    [rover N] picture [call id] [large | raw]
    [rover N] picture ground
    [rover N] [cancel] incident [call id]

Changes are those of `companion.wire.typed_answers`.
"""

from __future__ import annotations

import re
from dataclasses import dataclass

from companion.wire.answers import Answer, CancelIncident, PackIncident
from companion.wire.ids import Motion, Policy
from companion.wire.typed_answers import CommandError, in_range, read_typed

MAX_LINE = 1000
_ROVER = re.compile(r"rover\s+(\d{1,3})(?:\s*:\s*|\s+|\Z)", re.ASCII | re.IGNORECASE)
_CALL = re.compile(r"[ch]?(\d{1,5})(?:\s*:\s*|\s+|\Z)", re.ASCII | re.IGNORECASE)
_POLICY = re.compile(r"policy(?:\s+([a-z]+))?\Z", re.ASCII | re.IGNORECASE)
_PICTURE = re.compile(
    r"picture(?:(?:\s+[ch]?(\d{1,5}))?(?:\s+(large|raw))?|\s+(ground))\Z", re.ASCII | re.IGNORECASE
)
_INCIDENT = re.compile(r"(cancel\s+)?incident(?:\s+[ch]?(\d{1,5}))?\Z", re.ASCII | re.IGNORECASE)


@dataclass(frozen=True)
class Select:
    """Selects the rover of the line for all later lines that name none: `rover 2` alone."""


@dataclass(frozen=True)
class SetPolicy:
    """Requests a policy: `policy hold`."""

    policy: Policy


@dataclass(frozen=True)
class FetchPicture:
    """Fetches a picture: `picture`, `picture 7`, `picture 7 large`, `picture 7 raw`, `picture ground`.

    call_id None: of the open call. size: "", "large" or "raw"; "ground": what is known of the ground now.
    """

    call_id: int | None = None
    size: str = ""


@dataclass(frozen=True)
class Show:
    """Shows something or quits: `status`, `calls`, `words`, `help` or `quit`."""

    what: str


THING, GROUND = "THING", "GROUND"
"""Stand in what is proposed for the name of a thing or of ground: nobody but the operator knows it."""
_OPEN_NAME = re.compile(
    rf"(?<!\S)({THING}|{GROUND})(?=[\s:]|$)|(?:^|;\s*|\b(?i:tap)\s+)((?i:{THING}))(?=\s*:|\s+[-+.\d])"
)
"""In small letters "thing" is no name either, alone; "ground" is one, and "moving thing"."""
SHOWS = ("status", "calls", "words", "help", "quit")
Command = Answer | Select | SetPolicy | FetchPicture | Show
"""An answer is as it was typed: its target is 0 where none was named. One that is about an incident file asks
for it: `incident`, `incident 7`, `cancel incident 7`."""


def parse(line: str) -> tuple[int | None, Command] | None:
    """Parse a line: the rover that it names, None where it names none, and the command.

    None for an empty line or a `#` comment. Raises CommandError.
    """
    rest = line.replace("\t", " ").strip()
    if not rest or rest.startswith("#"):
        return None
    if not rest.isprintable():
        raise CommandError("the line holds characters that cannot be printed: type it again")
    if len(rest) > MAX_LINE:
        raise CommandError(f"a line of {len(rest)} characters: {MAX_LINE} at most")
    rover, rest = _leading(_ROVER, rest)
    if rover is not None:
        in_range("rover", rover, 1, 255)
    return rover, _command(rest) if rest else Select()


def _command(rest: str) -> Command:
    if rest.lower() in SHOWS:
        return Show(rest.lower())
    if found := _POLICY.match(rest):
        return SetPolicy(_policy(found[1]))
    if found := _PICTURE.match(rest):
        return FetchPicture(_number(found[1]), (found[2] or found[3] or "").lower())
    if found := _INCIDENT.match(rest):
        kind = CancelIncident if found[1] else PackIncident
        return Answer(0, Motion.NONE, (kind(_number(found[2]) or 0),))
    call_id, rest = _leading(_CALL, rest)
    if call_id is not None:
        in_range("call", call_id, 1, 0xFFFF)
    if not rest:
        raise CommandError(f"what about call {call_id}? Write it as `{call_id} go` or `{call_id} stay`")
    if found := _OPEN_NAME.search(rest):
        raise CommandError(
            f"{(found[1] or found[2]).upper()} stands for its name: write what it is, as in `drum: -1, go`"
        )
    return read_typed(rest, call_id or 0)


def _leading(pattern: re.Pattern[str], rest: str) -> tuple[int | None, str]:
    found = pattern.match(rest)
    return (int(found[1]), rest[found.end() :]) if found else (None, rest)


def _number(digits: str | None) -> int | None:
    return None if digits is None else in_range("call", int(digits), 1, 0xFFFF)


def _policy(name: str | None) -> Policy:
    try:
        return Policy[(name or "").upper()]
    except KeyError:
        names = ", ".join(policy.name.lower() for policy in Policy)
        raise CommandError(f"which policy? Write it as `policy hold`; there are {names}") from None
