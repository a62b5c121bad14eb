"""Judges what was encoded again with other sizes of tiles and thresholds: false stops against recall."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

from anytraverse.assessment import Assessment, Observation
from anytraverse.judging import Settings
from bench.perception.approaches import Approach
from bench.perception.figures import Figure, share
from bench.perception.judged import Judge
from bench.perception.things import KINDS, LARGE, SMALL

SHARES = (0.08, 0.12, 0.16, 0.25)
LIMITS = (0.5, 0.55, 0.6, 0.65, 0.7, 0.75, 0.8, 0.85, 0.9, 0.95)


@dataclass(frozen=True)
class Point:
    """Holds the figures at one setting. recalls: "place, group" -> share noticed in time."""

    tile_share: float
    limit: float
    false: dict[str, Figure]
    recalls: dict[str, Figure]


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
    recalls = {
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
    return Point(tile_share, limit, false, recalls)


def changed(settings: Settings, tile_share: float, limit: float) -> Settings:
    """Return the settings with another size of tiles and another threshold for them."""
    return replace(settings, tile_share=tile_share, thresholds=replace(settings.thresholds, tile=limit))


def table(points: Sequence[Point]) -> str:
    """Return a Markdown table with a line for every setting."""
    heads = [*points[0].false, *points[0].recalls]
    lines = [
        "| tile_share | tile | "
        + " | ".join([*(f"stopped: {h}" for h in points[0].false), *points[0].recalls]),
        "|---" * (2 + len(heads)) + "|",
    ]
    lines[0] += " |"
    for point in points:
        values = [*point.false.values(), *point.recalls.values()]
        lines.append(f"| {point.tile_share:g} | {point.limit:g} | " + " | ".join(map(str, values)) + " |")
    return "\n".join(lines)
