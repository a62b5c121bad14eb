"""The numbers of states, results and the like as docs/protocol.md lists them."""

from __future__ import annotations

from enum import IntEnum, IntFlag

from companion.wire.ids import Kind, Motion, Outcome, Policy, Reasons, Result, Stage, State

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


def markdown() -> str:
    """One line for each kind of number."""
    rows = ["| number | values |", "|---|---|"]
    for name, numbers in NUMBERS.items():
        values = (f"{one.value} {str(one.name).lower().replace('_', ' ')}" for one in numbers)
        rows.append(f"| {name} | {', '.join(values)} |")
    return "\n".join(rows) + "\n"
