"""Defines the one form that the result of every benchmark takes, in memory and as JSON."""

from __future__ import annotations

import json
import math
from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

FORM = 1
"""Raise it when a field changes its meaning."""
RAN, SKIPPED, FAILED = "ran", "skipped", "failed"


@dataclass(frozen=True)
class MeasuredFigure:
    """Holds one measured figure. low, high: its spread, None where that is not known.

    better: "less" or "more"; "" where neither is.
    """

    value: float
    unit: str
    better: str = ""
    low: float | None = None
    high: float | None = None

    @property
    def spread(self) -> tuple[float, float] | None:
        """Its least and greatest value; None where that is not known."""
        return None if self.low is None or self.high is None else (self.low, self.high)


@dataclass(frozen=True)
class BenchResult:
    """Holds what became of a benchmark.

    command: as a person types it, with OUT for the folder of the results. state: `RAN`, `SKIPPED` or
    `FAILED`, with the reason in `why`. seconds: that it took. run: commit, time and machine, as of
    `describe_run`. figures: text -> figure. series: plots, as of `bench.series`. told: the rest of
    the benchmark's last line, None where that was no JSON object.
    """

    name: str
    measures: str
    command: str
    quick: bool
    state: str
    why: str
    seconds: float
    run: Mapping[str, Any]
    figures: Mapping[str, MeasuredFigure] = field(default_factory=dict)
    series: tuple[Mapping[str, Any], ...] = ()
    told: Mapping[str, Any] | None = None


class RubbishError(ValueError):
    """Reports a last line that is not what the benchmark should print. The text says why."""


@dataclass(frozen=True)
class Quoted:
    """Says where a figure stands in the last line: keys with / between. spread: of [low, high]."""

    path: str
    what: str
    unit: str
    better: str = ""
    spread: str = ""

    def found(self, told: Mapping[str, Any]) -> MeasuredFigure | None:
        """Returns the figure; None where it is null or absent. Raises RubbishError."""
        value = _at(told, self.path)
        if value is None:
            return None
        low, high = _at(told, self.spread) or (None, None)
        if not all(_is_number(one) for one in (value, low, high) if one is not None):
            raise RubbishError(f"{self.path} is {value!r}, and no number")
        return MeasuredFigure(value, self.unit, self.better, low, high)


def _is_number(value: object) -> bool:
    return isinstance(value, (int, float)) and not isinstance(value, bool) and math.isfinite(value)


def _at(told: Mapping[str, Any], path: str) -> Any:
    found: Any = told
    for key in path.split("/"):
        found = found.get(key) if isinstance(found, Mapping) else None
    return found


def last_line(text: str) -> dict[str, Any]:
    """Reads the last line of an output. Raises RubbishError when that is no JSON object."""
    lines = text.strip().splitlines()
    if not lines:
        raise RubbishError("it printed nothing")
    try:
        told = json.loads(lines[-1])
    except ValueError:
        told = None
    if not isinstance(told, dict):
        raise RubbishError(f"its last line is no JSON object: {lines[-1][:120]}")
    return told


def figures_of(told: Mapping[str, Any], quoted: tuple[Quoted, ...]) -> dict[str, MeasuredFigure]:
    """Returns the quoted figures, and checks the series. Raises RubbishError."""
    found = {one.what: figure for one in quoted if (figure := one.found(told)) is not None}
    if quoted and not found and "skipped" not in told:
        raise RubbishError(f"its last line has none of its figures, such as {quoted[0].path}")
    try:
        list(points_of(told.get("series", ())))
        return found
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise RubbishError(f"its series cannot be read: {error!r}") from error


def points_of(all_series: Any, most: float = math.inf) -> Iterator[tuple[str, MeasuredFigure]]:
    """Yields each point of the lines that have at most so many; what it is, and the figure."""
    for series in all_series:
        for line, points in series["lines"].items():
            for x, *figures in points if len(points) <= most else ():
                value, low, high = map(float, figures)
                if not all(map(math.isfinite, (x, value, low, high))):
                    raise ValueError(f"{line} at {x} is not finite")
                what = f"{series['title']}: {line}, {x:,} {series['x']}"
                yield what, MeasuredFigure(value, series["unit"], "less", low, high)


def write_result(folder: Path, result: BenchResult) -> Path:
    """Writes NAME.json, and returns its path."""
    path = folder / f"{result.name}.json"
    path.write_text(json.dumps({"form": FORM, **asdict(result)}, indent=1) + "\n", encoding="utf-8")
    return path


def read_results(folder: Path) -> dict[str, BenchResult]:
    """Reads all results of a folder, by name. Files of another form are left out."""
    found = {}
    for path in sorted(folder.glob("*.json")):
        try:
            content = json.loads(path.read_text(encoding="utf-8"))
            if not isinstance(content, dict) or content.pop("form", None) != FORM:
                continue
            content["figures"] = {what: MeasuredFigure(**one) for what, one in content["figures"].items()}
            content["series"] = tuple(content["series"])
            found[path.stem] = BenchResult(**content)
        except (OSError, ValueError, TypeError, KeyError, AttributeError):
            continue
    return found
