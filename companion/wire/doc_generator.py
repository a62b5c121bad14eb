"""Formats the tables of numbers and parameters for docs/protocol.md."""

from __future__ import annotations

from enum import Flag, IntEnum, IntFlag
from typing import NamedTuple

from companion.wire.ids import Kind, Motion, Outcome, Policy, Reasons, Result, Stage, State
from companion.wire.parameters import WORD_PREFIX, Parameter, build

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


def numbers_markdown() -> str:
    """Format a table with one row for each kind of number."""
    rows = ["| number | values |", "|---|---|"]
    for name, numbers in NUMBERS.items():
        rows.append(f"| {name} | {_listed(numbers)} |")
    return "\n".join(rows) + "\n"


def _listed(numbers: type[IntEnum] | type[IntFlag]) -> str:
    # Python 3.10 lists the flag 0, too.
    listed = (one for one in numbers if one.value or not isinstance(one, Flag))
    return ", ".join(f"{one.value} {str(one.name).lower().replace('_', ' ')}" for one in listed)


class Line(NamedTuple):
    """One row of the table of parameters.

    unit: "" for a plain number. default: the first value, and where it is configured. kept: whether it
    survives a restart.
    """

    meaning: str
    unit: str
    default: str
    kept: str


_KEPT = "yes"
_NO = "no"
_THRESHOLD = "the perceiver's, or `[thresholds] {}`"
LINES: dict[str, Line] = {
    "AT_THR_ROI": Line("mean uncertainty of the ROI that calls", "", _THRESHOLD.format("roi"), _KEPT),
    "AT_THR_SCENE": Line(
        "cosine to the reference scene below which it calls", "", _THRESHOLD.format("scene"), _KEPT
    ),
    "AT_THR_TILE": Line(
        "uncertainty of the ROI's worst tile that calls; -2: not judged", "", _THRESHOLD.format("tile"), _KEPT
    ),
    "AT_THR_TRAV": Line("drivable share below which it is blocked", "", "0.4, `[thresholds] trav`", _KEPT),
    "AT_POLICY": Line(_listed(Policy), "", "`[call] policy`", "off only"),
    f"{WORD_PREFIX}<WORD>": Line("weight of a word; -2: not in use", "", "`[words]`", _KEPT),
    "AT_SHD_HOLDS": Line("would-be holds; set to 0 to count anew", "", "0", _KEPT),
    "AT_SHD_HOURS": Line("in which they were counted; read-only", "h", "0", _KEPT),
    "AT_SHD_SCENE": Line("of them began for an unknown scene; read-only", "", "0", _KEPT),
    "AT_SHD_OBJECT": Line("... for an unknown thing; read-only", "", "0", _KEPT),
    "AT_SHD_BLOCKED": Line("... for a blocked way; read-only", "", "0", _KEPT),
    "AT_SHD_FAULT": Line("... for a fault; read-only", "", "0", _KEPT),
    "AT_ROI_L": Line("left side of the region of interest", "of the width", "0.333, `[roi] left`", _KEPT),
    "AT_ROI_T": Line("its upper side", "of the height", "0.6, `[roi] top`", _KEPT),
    "AT_ROI_R": Line("its right side", "of the width", "0.667, `[roi] right`", _KEPT),
    "AT_ROI_B": Line("its lower side", "of the height", "0.95, `[roi] bottom`", _KEPT),
    "AT_SUM_HZ": Line("summaries; 0: none", "1/s", "1", _KEPT),
    "AT_NUM_HZ": Line("each of the numbers; 0: none", "1/s", "0.5", _KEPT),
    "AT_BUDGET": Line(
        "unsolicited traffic on the first connection; 0: unlimited", "B/s", "300, `[link] budget`", _KEPT
    ),
    "AT_ANSWER": Line(
        "id of the call or hold x 10 + 1 go, 2 stay, 3 look again; id 0: the current one. Or the call whose "
        "place matched x 10 + 4: it is another place; id 0: whichever matched",
        "",
        "0",
        _NO,
    ),
    "AT_TAP_WORD": Line(
        "index of the word's parameter that the next tap in the video names; -1: an obstacle. "
        "A tap resets it",
        "",
        "-1",
        _NO,
    ),
}
_WORD = "any"


def parameters_markdown() -> str:
    """Format the table of parameters, in their order and with their own ranges."""
    rows = ["| parameter | meaning | values | unit | default | kept |", "|---|---|---|---|---|---|"]
    for parameter in build((_WORD,), {}, {}):
        name = f"{WORD_PREFIX}<WORD>" if parameter.word else parameter.name
        line = LINES[name]
        cells = (f"`{name}`", line.meaning, _values(parameter), line.unit, line.default, line.kept)
        rows.append(f"| {' | '.join(cells)} |")
    return "\n".join(rows) + "\n"


def _values(parameter: Parameter) -> str:
    return f"{parameter.allowed()}, whole" if parameter.whole else parameter.allowed()
