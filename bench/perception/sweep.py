"""Judges what was encoded again with other sizes of tiles and thresholds: false stops against recall."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

from anytraverse.assessment import Assessment, Observation
from bench.perception.approaches import Approach
from bench.perception.figures import Figure, share
from bench.perception.judged import Judge, changed
from bench.perception.things import KINDS, LARGE, SMALL

SHARES = (0.08, 0.12, 0.16, 0.25)
COVERED = (0.01, 0.02, 0.05, 0.1, 0.2, 1.0)
"""Bounds of the share of the region of interest that a thing's box covers."""
LIMITS = (0.5, 0.55, 0.6, 0.65, 0.7, 0.75, 0.8, 0.85, 0.9, 0.95)


@dataclass(frozen=True)
class Point:
    """Holds the figures at one setting.

    false: place -> clean frames that are not OK. noticed: "place, group" -> things noticed in time. seen: how
    much of the region of interest a thing's box covers -> frames that are not OK.
    """

    tile_share: float
    limit: float
    false: dict[str, Figure]
    noticed: dict[str, Figure]
    seen: dict[str, Figure]

    def as_json(self) -> dict[str, Any]:
        """Return the point for the results' file."""
        named = (("false", self.false), ("noticed", self.noticed), ("seen", self.seen))
        parts = {name: {k: v.as_json() for k, v in part.items()} for name, part in named}
        return {"tile_share": self.tile_share, "tile": self.limit, **parts}


def sweep(judge: Judge, clean: dict[str, list[Assessment]], driven: Sequence[Approach]) -> list[Point]:
    """Judge clean frames and whole approaches at every setting."""
    return [_point(judge, clean, driven, tile_share, limit) for tile_share in SHARES for limit in LIMITS]


def _point(
    judge: Judge,
    clean: dict[str, list[Assessment]],
    driven: Sequence[Approach],
    tile_share: float,
    limit: float,
) -> Point:
    other = judge.with_settings(changed(judge.settings, tile_share, limit))
    known: dict[int, bool] = {}

    def ok(seen: Observation) -> bool:
        if id(seen) not in known:
            known[id(seen)] = other.again(seen).ok
        return known[id(seen)]

    false = {
        place: share([not ok(one.observation) for one in judged if one.observation is not None])
        for place, judged in clean.items()
    }
    noticed = {
        f"{place}, {group}": share(
            [
                one.noticed_at(ok) is not None
                for one in driven
                if one.place == place and KINDS[one.kind].group == group and one.counts(ok)
            ]
        )
        for place in ("home", "abroad")
        for group in (LARGE, SMALL)
    }
    counted = [one for one in driven if one.counts(ok)]
    seen = {
        f"{low:.0%} to {high:.0%} of the ROI": share(
            [
                not ok(frame.observation)
                for one in counted
                for frame, part in zip(one.frames, one.covered, strict=True)
                if frame.observation is not None and low <= part < high
            ]
        )
        for low, high in pairwise(COVERED)
    }
    return Point(tile_share, limit, false, noticed, seen)


def table(points: Sequence[Point]) -> str:
    """Return a Markdown table with a line for every setting."""
    heads = [*(f"stopped: {h}" for h in points[0].false), *points[0].noticed, *points[0].seen]
    lines = [f"| tile_share | tile | {' | '.join(heads)} |", "|---" * (2 + len(heads)) + "|"]
    for point in points:
        values = [
            figure.brief for part in (point.false, point.noticed, point.seen) for figure in part.values()
        ]
        lines.append(f"| {point.tile_share:g} | {point.limit:g} | " + " | ".join(values) + " |")
    return "\n".join(lines)
