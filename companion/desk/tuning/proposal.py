"""Chooses thresholds and a region of interest for a wanted rate of calls. Pure."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from anytraverse.judging import Settings
from anytraverse.regions import Box
from companion.config import Config
from companion.config.stopping import Stopping, judge_stopping, with_settings
from companion.desk.drives.drive import DriveError
from companion.desk.tuning.choice import combination
from companion.desk.tuning.episode import NEAR_S, Given
from companion.desk.tuning.trial import Combination, Grid, TrialOutcome

_SHARES = (0.05, 0.02, 0.005)
"""Of the frames that are beyond a threshold of the grid. Where more are, calls are no exception any more."""
_BEYOND = 0.02
"""How far beyond all frames the last threshold of the grid is."""
_LARGEST = 0.99
MOST_WANTED = 60.0
"""Calls a minute."""


@dataclass(frozen=True)
class Candidate:
    """A combination, and what it costs and keeps.

    rate: calls a minute. kept: how many of the named things still open a call. halves: calls in the first and
    the second half of the drive. holds: how often a rover would be held.
    """

    combination: Combination
    rate: float
    kept: int
    halves: tuple[int, int]
    holds: int

    def row(self) -> dict[str, Any]:
        """Return it as JSON values."""
        return {
            **combination(self.combination),
            "calls_per_minute": round(self.rate, 3),
            "kept": self.kept,
            "first_half": self.halves[0],
            "second_half": self.halves[1],
            "would_hold": self.holds,
        }


def named_times(answers: Sequence[Given]) -> list[float]:
    """Return when the calls opened that somebody answered with words or a tap, each once."""
    return sorted({at for at, answer in answers if answer.operations})


def weighed(outcome: TrialOutcome, named: Sequence[float], seconds: float) -> Candidate:
    """Weigh a combination. named: as `named_times` returns them. seconds: of the drive."""
    at = [call.at for call in outcome.calls]
    kept = sum(any(abs(one - call) <= NEAR_S for call in at) for one in named)
    first = sum(2 * call <= seconds for call in at)
    rate = 60.0 * len(at) / seconds
    return Candidate(outcome.combination, rate, kept, (first, len(at) - first), outcome.would_hold)


def proposed(candidates: Sequence[Candidate], now: Combination, wanted: float) -> Candidate:
    """Return the best candidate. wanted: calls a minute, at most.

    The best one calls no more often than wanted. Of several, it keeps the most named things, then it calls
    most often, then it changes the fewest settings. Where all call too often, it calls least often.
    """
    # More calls within the wanted rate are better: thresholds that call less let more pass unseen.
    within = [one for one in candidates if one.rate <= wanted]
    if not within:
        return min(candidates, key=lambda one: (one.rate, -one.kept, changes(one.combination, now)))
    return min(within, key=lambda one: (-one.kept, -one.rate, changes(one.combination, now)))


def in_time(
    candidates: Sequence[Candidate], now: Combination, settings: Settings, config: Config
) -> list[Candidate]:
    """Return the candidates by which a thing is seen early enough to stop, or no later than now.

    All of them where mount or speed are not configured. settings: in force.
    """
    before = _stopping(now, settings, config)
    if isinstance(before, str):
        return list(candidates)
    found = []
    for one in candidates:
        judged = _stopping(one.combination, settings, config)
        if isinstance(judged, Stopping) and (judged.enough or judged.sees >= before.sees):
            found.append(one)
    return found


def _stopping(one: Combination, settings: Settings, config: Config) -> Stopping | str:
    return judge_stopping(with_settings(config, one.applied(settings)), tile=one.tile)


def refuse_short(seconds: float, wanted: float) -> None:
    """Raise DriveError for a drive in which one call is more than is wanted: only silence would do."""
    if seconds * wanted >= 60.0:
        return
    least = math.ceil(6000.0 / seconds) / 100 if seconds > 0.0 else math.inf
    more = f", or --calls-per-minute {least:g}" if least <= MOST_WANTED else ""
    raise DriveError(
        f"the drive lasts {round(seconds, 1):g} s, and one call in it is already more than {wanted:g} "
        f"a minute: give a drive of {math.ceil(60.0 / wanted)} s or more{more}"
    )


def warnings(before: Candidate, best: Candidate, named: int) -> list[str]:
    """Return what a proposal loses, for a person."""
    found = []
    old, new = before.combination, best.combination
    if best.rate == 0.0:
        found.append("by the proposal this drive never calls: it may be blind")
    if best.kept < before.kept:
        found.append(
            f"{before.kept - best.kept} of {named} things that somebody named would no longer call: "
            "the rover would drive on there"
        )
    elif named and not best.kept:
        found.append("nothing that somebody named calls")
    if best.holds < before.holds:
        found.append(
            f"would-be holds are {best.holds} instead of {before.holds}: "
            "the thresholds that call less also stop it less"
        )
    box, own = new.region, old.region
    if box.left > own.left or box.top > own.top or box.right < own.right or box.bottom < own.bottom:
        found.append("the region is smaller: what lies beside it does not stop the rover, which must fit in")
    return [f"WARNING: {one}" for one in found]


def grid_of(
    similarities: Sequence[float],
    uncertainties: Sequence[float],
    tiles: Sequence[float],
    settings: Settings,
    regions: Sequence[Box] = (),
) -> Grid:
    """Return a grid of thresholds that this drive tells apart, with those in force.

    similarities, uncertainties, tiles: of its frames. The thresholds are quantiles of these, and one that all
    frames stay within. The vehicle fits into each region.
    """
    limits = settings.thresholds
    scene = _values(similarities, _SHARES, -_BEYOND, limits.scene)
    above = [1.0 - share for share in _SHARES]
    roi = _values(uncertainties, above, _BEYOND, limits.roi)
    tile: tuple[float | None, ...] = (
        (None,) if limits.tile is None else _values(tiles, above, _BEYOND, limits.tile)
    )
    others = (box for box in variants(settings.region.bounds) if not settings.corridor.misfit(box))
    return Grid(scene, roi, tile, tuple(regions) or tuple(others))


def variants(box: Box) -> tuple[Box, ...]:
    """Return a region, and four others: narrower, wider, shorter and longer by a fifth."""
    width, height = box.right - box.left, box.bottom - box.top
    found = [box]
    for factor in (0.8, 1.25):
        aside = width * (factor - 1.0) / 2.0
        found.append(_box(box.left - aside, box.top, box.right + aside, box.bottom))
    found += [_box(box.left, box.bottom - height * factor, box.right, box.bottom) for factor in (0.8, 1.25)]
    return tuple(dict.fromkeys(found))


def differing(chosen: Combination, now: Combination) -> dict[str, float | str]:
    """Return by which settings of companion.toml a combination differs from now: "section.key" -> value."""
    found: dict[str, float | str] = {}
    for name in ("roi", "scene", "tile"):
        new = getattr(chosen, name)
        if new != getattr(now, name):
            found[f"thresholds.{name}"] = "off" if new is None else new
    if chosen.region != now.region:
        box = chosen.region
        found |= {f"roi.{side}": getattr(box, side) for side in ("left", "top", "right", "bottom")}
    return found


def fragment(chosen: Combination, now: Combination, remarks: Sequence[str]) -> str:
    """Return the part of a companion.toml that puts a combination into force: what differs from now."""
    lines, sections = [f"# {one}" for one in remarks], set[str]()
    settings = differing(chosen, now)
    for key, value in settings.items():
        section, _, name = key.partition(".")
        if section not in sections:
            sections.add(section)
            lines += ["", f"[{section}]"]
        lines.append(f'{name} = "{value}"' if isinstance(value, str) else f"{name} = {value:g}")
    return "\n".join([*lines, ""])


def _values(
    figures: Sequence[float], shares: Sequence[float], beyond: float, in_force: float
) -> tuple[float, ...]:
    """Return quantiles, a value beyond them all, and the one in force; rising."""
    if not figures:
        return (in_force,)
    found = [*np.quantile(np.asarray(figures), shares), (max if beyond > 0.0 else min)(figures) + beyond]
    return tuple(sorted({*(min(_LARGEST, max(0.01, round(float(one), 3))) for one in found), in_force}))


def _box(left: float, top: float, right: float, bottom: float) -> Box:
    return Box(*(round(min(1.0, max(0.0, side)), 3) for side in (left, top, right, bottom)))


def changes(one: Combination, now: Combination) -> int:
    """Return how many settings a combination changes; a region is one."""
    return sum(getattr(one, name) != getattr(now, name) for name in ("scene", "roi", "tile", "region"))
