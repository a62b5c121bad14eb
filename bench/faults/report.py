"""Judges what came out of the rows, sums it up, keeps it, and writes docs/faults.md's table of it.

`python -m bench.faults.report` puts the table into that page, from the committed results.
"""

from __future__ import annotations

import json
import os
import platform
import subprocess
from collections.abc import Iterable, Mapping, Sequence
from datetime import datetime, timezone
from pathlib import Path
from typing import Any

from bench.bounds import told
from bench.faults.row import Row, RowOutcome
from bench.faults.table import ROWS

RESULTS = Path(__file__).parents[1] / "results" / "faults.json"
PAGE = Path(__file__).parents[2] / "docs" / "faults.md"
COLUMNS = ("fault", "what follows", "runs, fails in", "hold, s", "return, s")


def wrong(row: Row, outcome: RowOutcome, *, short: bool) -> list[str]:
    """Returns what was wrong: runs that did not end as they must, and in the long form what took too long."""
    found = list(outcome.wrong) if outcome.runs else [*outcome.wrong, "never produced"]
    limits = (("hold", outcome.hold_s, row.hold_within), ("return", outcome.return_s, row.return_within))
    for name, seconds, limit in limits:
        if short or limit is None:
            continue
        if seconds is None:
            found.append(f"no {name} was measured")
        elif seconds > limit:
            found.append(f"{name} after {seconds:.2f} s, limit {limit:g} s")
    return found


def judged(row: Row, outcome: RowOutcome, *, short: bool) -> dict[str, Any]:
    """Returns a row's figures. safe: it ended as it must, and that is safe."""
    found = wrong(row, outcome, short=short)
    return {
        "fault": row.fault,
        "runs": outcome.runs,
        "safe": not found and not row.exception,
        "hold_s": outcome.hold_s,
        "return_s": outcome.return_s,
        "saw": outcome.saw,
        **({"wrong": found} if found else {}),
        **({"exception": row.exception} if row.exception else {}),
    }


def line(figures: Mapping[str, Any]) -> str:
    """Formats a row as a line for a reader."""
    hold, returned = (_seconds(figures[name]) for name in ("hold_s", "return_s"))
    said = f"{_verdict(figures):8} {figures['fault']}: {_runs(figures)}, hold {hold}, return {returned}"
    return f"{said}  {figures['saw']}" + "".join(f"\n         {one}" for one in figures.get("wrong", ())[:5])


def summed(rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """Sums up rows; the worst figures are of all of them."""
    return {
        "rows": list(rows),
        "safe": sum(row["safe"] for row in rows),
        "worst_hold_s": max((row["hold_s"] for row in rows if row["hold_s"] is not None), default=None),
        "worst_return_s": max((row["return_s"] for row in rows if row["return_s"] is not None), default=None),
    }


def keep(path: Path, rows: Iterable[Mapping[str, Any]], command: str) -> None:
    """Writes rows into a file of results; rows that it has of other faults of the table stay."""
    run = {
        "commit": subprocess.run(
            ["git", "rev-parse", "--short", "HEAD"], capture_output=True, text=True, check=False
        ).stdout.strip(),
        "date": datetime.now(timezone.utc).date().isoformat(),
        "load": round(os.getloadavg()[2], 1),
    }
    known = {row["fault"]: row for row in read(path)}
    known |= {row["fault"]: {**row, **run} for row in rows}
    content = {
        "command": command,
        "machine": f"{os.cpu_count()} cores {platform.machine()}",
        "figures": summed([known[row.fault] for row in ROWS if row.fault in known]),
    }
    path.write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


def read(path: Path) -> list[dict[str, Any]]:
    """Reads the rows of a file of results; none where there is no file."""
    if not path.exists():
        return []
    rows: list[dict[str, Any]] = json.loads(path.read_text(encoding="utf-8"))["figures"]["rows"]
    return rows


def document(rows: Iterable[Row], results: Sequence[Mapping[str, Any]]) -> str:
    """Formats rows and what came out of them as the table of docs/faults.md."""
    known = {figures["fault"]: figures for figures in results}
    lines = [f"| {' | '.join(COLUMNS)} |", f"|{'---|' * len(COLUMNS)}"]
    for row in rows:
        cells = [row.fault, *_cells(row, known.get(row.fault))]
        lines.append(f"| {' | '.join(cell.replace('|', '/') for cell in cells)} |")
    return "\n".join(lines)


def _cells(row: Row, figures: Mapping[str, Any] | None) -> list[str]:
    if figures is None:
        return [row.safe_state, "not run yet", "", ""]
    unsafe = f"🔴 **NOT SAFE**: {figures['saw']}"
    said = [row.safe_state] if figures["safe"] else [unsafe, *figures.get("wrong", ()), row.exception]
    times = (
        "" if seconds is None else f"{seconds:.2f}" for seconds in (figures["hold_s"], figures["return_s"])
    )
    return [". ".join(text for text in said if text), _runs(figures), *times]


def _runs(figures: Mapping[str, Any]) -> str:
    runs = figures["runs"]
    return f"{runs}, {told(runs, min(len(figures.get('wrong', ())), runs)).replace(' ', '')}" if runs else "0"


def _seconds(value: float | None) -> str:
    return "-" if value is None else f"{value:.2f} s"


def _verdict(figures: Mapping[str, Any]) -> str:
    return "safe" if figures["safe"] else "WRONG" if figures.get("wrong") else "NOT SAFE"


def main() -> None:
    """Replaces the table in docs/faults.md."""
    lines = PAGE.read_text(encoding="utf-8").split("\n")
    others = [line for line in lines if not line.startswith("|")]
    at = next(number for number, line in enumerate(lines) if line.startswith("|"))
    PAGE.write_text("\n".join([*others[:at], document(ROWS, read(RESULTS)), *others[at:]]), encoding="utf-8")


if __name__ == "__main__":
    main()
