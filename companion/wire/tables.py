"""Writes the tables of docs/protocol.md from the data that the code uses: `python -m companion.wire.tables`.

Each stands between `<!-- table: NAME -->` and `<!-- end -->`; `TABLES` has the names.
"""

from __future__ import annotations

import re
import textwrap
from collections.abc import Iterable
from enum import Flag, IntEnum, IntFlag
from pathlib import Path
from typing import get_args

from companion.wire import layouts
from companion.wire.examples import EXAMPLES, PARAMETER_FILE
from companion.wire.ids import Kind, Motion, Outcome, Policy, Reasons, Result, Stage, State
from companion.wire.layouts import Layout
from companion.wire.messages import ASKED, DOWN, IN, OUT, TABLE, UP, Direction, Message
from companion.wire.parameters import WORD_PREFIX, build
from companion.wire.refusals import COUNTED, Rejected

PAGE = Path(__file__).parents[2] / "docs" / "protocol.md"
_MARKED = re.compile(r"(?<=<!-- table: )([a-z0-9 ]+)( -->\n).*?(?=<!-- end -->)", re.DOTALL)

NUMBERS: dict[str, type[IntEnum] | type[IntFlag]] = {
    "state": State,
    "policy": Policy,
    "reasons, bits": Reasons,
    "kind": Kind,
    "stage": Stage,
    "outcome": Outcome,
    "motion": Motion,
    "result": Result,
}
_ONE_WORD = "any"
_WIDTH = 118


PARAMETERS: dict[str, str] = {
    "AT_THR_ROI": "mean uncertainty of the region that calls",
    "AT_THR_SCENE": "similarity below which it calls",
    "AT_THR_TILE": "uncertainty of the worst tile that calls; -2: not judged",
    "AT_THR_TRAV": "drivable share below which it is blocked",
    "AT_POLICY": "number, see [Payloads](#payloads)",
    f"{WORD_PREFIX}<WORD>": "weight of a word; -2: not in use",
    "AT_SHD_HOLDS": "holds that policy shadow would have commanded; 0 begins anew",
    "AT_SHD_HOURS": "hours of it, read-only as those below",
    "AT_SHD_SCENE": "of them for an unknown scene",
    "AT_SHD_OBJECT": "... thing",
    "AT_SHD_BLOCKED": "... a blocked way",
    "AT_SHD_FAULT": "... a fault",
    "AT_ROI_L": "left side of the region of interest",
    "AT_ROI_T": "its upper side",
    "AT_ROI_R": "its right side",
    "AT_ROI_B": "its lower side",
    "AT_SUM_HZ": "summaries a second",
    "AT_NUM_HZ": "each of the numbers, a second",
    "AT_BUDGET": "B/s unsolicited on the first connection; 0: unlimited",
    "AT_ANSWER": "id x 10 + 1 go, 2 stay, 3 look again; matched call x 10 + 4: another place",
    "AT_TAP_WORD": "index of the word that the next tap in the video names; -1: an obstacle",
}
"""What a reader needs of a parameter beside its name and range."""


def _numbers() -> str:
    return "".join(f"- {name}: {_listed(numbers)}\n" for name, numbers in NUMBERS.items())


def _listed(numbers: type[IntEnum] | type[IntFlag]) -> str:
    # Python 3.10 lists the flag 0, too.
    listed = (one for one in numbers if one.value or not isinstance(one, Flag))
    return ", ".join(f"{one.value} {str(one.name).lower().replace('_', ' ')}" for one in listed)


def _parameters() -> str:
    """In their order, with their own ranges."""
    rows = []
    for parameter in build((_ONE_WORD,), {}, {}):
        name = f"{WORD_PREFIX}<WORD>" if parameter.word else parameter.name
        rows.append((f"`{name}`", parameter.allowed(), PARAMETERS[name]))
    return _table("parameter | values | meaning", rows)


def _messages() -> str:
    """What goes to the ground; what is one MAVLink message is one row."""
    merged: dict[str, list[Message]] = {}
    chosen = (one for one in TABLE if one.direction == UP and not one.of_camera and " asked" not in one.name)
    for message in sorted(chosen, key=lambda one: one.priority or 0):
        merged.setdefault(message.mavlink, []).append(message)
    rows = ((name, *_cells(messages)) for name, messages in merged.items())
    return _table("message | what for | every | bytes", rows)


def _cells(messages: list[Message]) -> Iterable[str]:
    purposes = dict.fromkeys(one.purpose + ("*" if one.bucket == ASKED else "") for one in messages)
    period = next((f"{one.period:g} s" for one in messages if one.period), "")
    return "; ".join(purposes), period, str(max(one.bytes for one in messages))


def _names(direction: Direction, *, of_camera: bool) -> str:
    """The same as one line: names, with their period."""
    periods: dict[str, str] = {}
    for one in TABLE:
        if (one.direction, one.of_camera) == (direction, of_camera):
            name = one.mavlink.replace("*", r"\*")
            periods.setdefault(name, f" ({one.period:g} s)" if one.period else "")
    return "\n".join(textwrap.wrap(", ".join(map("".join, periods.items())), _WIDTH)) + "\n"


def _refusals() -> str:
    return "".join(f"- `{name}`: {COUNTED[name]}\n" for name in get_args(Rejected))


def _table(heads: str, rows: Iterable[Iterable[str]]) -> str:
    lines = [f"| {heads} |", "|" + "---|" * (heads.count("|") + 1)]
    return "\n".join([*lines, *(f"| {' | '.join(row)} |" for row in rows)]) + "\n"


def _layout(layout: Layout, indent: str = "") -> str:
    """One line a field: its offset, type, name and values."""
    lines, offset = [], layout.start
    for field in layout.fields:
        values = f"  {field.values}" if field.values else ""
        lines.append(f"{indent}{offset:2}  {field.type:7} {field.name}{values}")
        offset += field.size
    return "\n".join(lines)


def _fenced(text: str) -> str:
    return f"```text\n{text}\n```\n"


def _payload(layout: Layout, example: str) -> str:
    says = re.sub(r"<\w+\.(\w+): \d+>", r"\1", str(EXAMPLES[example]))
    says = re.sub(r", (sender|why)=.*", ")", says)  # what is not in the payload
    told = "\n".join(textwrap.wrap(f"{EXAMPLES[example].pack().hex()} is {says}", _WIDTH))
    return _fenced(f"{_layout(layout)}\n\n{told}")


def _operations() -> str:
    blocks = (f"{one.title}\n{_layout(one, '  ')}".rstrip() for one in layouts.OPERATIONS.values())
    return _fenced("\n".join(blocks))


TABLES = {
    "to ground": _messages,
    "from ground": lambda: _names(DOWN, of_camera=False),
    "to autopilot": lambda: _names(OUT, of_camera=False),
    "from autopilot": lambda: _names(IN, of_camera=False),
    "camera": lambda: _names(UP, of_camera=True),
    "numbers": _numbers,
    "summary": lambda: _payload(layouts.SUMMARY, "summary"),
    "call": lambda: _payload(layouts.CALL, "call"),
    "answer": lambda: _payload(layouts.ANSWER, "answer"),
    "operations": _operations,
    "acknowledgement": lambda: _payload(layouts.ACKNOWLEDGEMENT, "acknowledgement"),
    "parameters": _parameters,
    "parameter file": lambda: _fenced(PARAMETER_FILE.hex()),
    "refusals": _refusals,
}


def filled(page: str) -> str:
    """Returns the page with its marked tables as the code has them. Raises KeyError for an unknown name."""
    return _MARKED.sub(lambda found: found[1] + found[2] + TABLES[found[1]](), page)


if __name__ == "__main__":
    PAGE.write_text(filled(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
