"""Judges a drive by many combinations of settings at once: each frame is perceived once for all of them.

Reads the grid of thresholds and regions, whose combinations these are.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import product
from typing import Any, NamedTuple

from anytraverse.assessment import Assessment, Finding, Maps, Observation
from anytraverse.engine import AnyTraverse
from anytraverse.errors import AnyTraverseError
from anytraverse.judging import Settings
from anytraverse.light import Light
from anytraverse.perception import Example
from anytraverse.preferences import Preferences
from anytraverse.regions import Box
from anytraverse.roi import RoiFigures
from companion.calls.decisions import Call
from companion.desk.drives.drive import DriveFrame
from companion.desk.drives.judge import DriveJudge
from companion.desk.tuning.episode import Operator
from companion.wire.typed_answers import CommandError

MOST = 10_000
MOST_REGIONS = 10


@dataclass(frozen=True)
class Combination:
    """Holds thresholds and a region of interest, as in `Thresholds` and `Settings`.

    tile: None: not judged. misfit_allowed: as in `Settings`, for an evaluation.
    """

    scene: float
    roi: float
    tile: float | None
    region: Box
    misfit_allowed: bool = False

    @classmethod
    def of(cls, settings: Settings) -> Combination:
        """Return what these settings have."""
        limits = settings.thresholds
        return cls(limits.scene, limits.roi, limits.tile, settings.region.bounds)

    @classmethod
    def read(cls, row: Mapping[str, Any]) -> Combination:
        """Return a combination that was written as JSON values. Raises GridError."""
        try:
            left, top, right, bottom = (_fraction(side) for side in row["region"])
            tile = None if row["tile"] is None else _fraction(row["tile"])
            box = Box(left, top, right, bottom)
            return cls(_fraction(row["scene"], least=-1.0), _fraction(row["roi"]), tile, box)
        except (KeyError, TypeError, ValueError, AnyTraverseError) as error:
            raise GridError(f"it holds no setting that can be used ({error}): write it anew") from error

    def applied(self, base: Settings) -> Settings:
        """Return `base` with these instead. Raises SettingsError for a number out of its range."""
        limits = replace(base.thresholds, scene=self.scene, roi=self.roi, tile=self.tile)
        return replace(
            base, thresholds=limits, region=self.region, misfit_allowed=self.misfit_allowed, ground=None
        )


def _fraction(value: Any, least: float = 0.0) -> float:
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not least <= value <= 1.0:
        raise ValueError(f"{str(value)[:40]} is no number from {least:g} to 1")
    return float(value)


class MadeCall(NamedTuple):
    """A call. frame: its place in the drive, from 0. at: seconds of the drive. reasons: by name, sorted."""

    frame: int
    at: float
    reasons: tuple[str, ...]


@dataclass
class TrialOutcome:
    """Holds what a drive led to by one combination.

    matches: places in the drive at which a remembered scene was known again. refused: answers that changed
    nothing, and why. stood: first and last places of frames at which a call opened or a rover would be held.
    """

    combination: Combination
    calls: list[MadeCall] = field(default_factory=list)
    matches: list[int] = field(default_factory=list)
    refused: list[str] = field(default_factory=list)
    not_ok: int = 0
    would_hold: int = 0
    stood: list[tuple[int, int]] = field(default_factory=list)

    def stands(self, number: int) -> None:
        """Note that it stands at a frame, which follows the frames noted before."""
        goes_on = bool(self.stood) and self.stood[-1][1] == number - 1
        first = self.stood.pop()[0] if goes_on else number
        self.stood.append((first, number))


class Trial:
    """Judges a drive by one combination, as `companion rehearse` does, and answers every call.

    A call that the answer does not cover gets a go, so that each place is asked about once.
    """

    def __init__(self, combination: Combination, judge: DriveJudge, operator: Operator) -> None:
        self.outcome = TrialOutcome(combination)
        self._judge = judge
        self._operator = operator

    def step(self, number: int, frame: DriveFrame) -> Assessment | None:
        """Judge a frame; None for a torn one. number: its place in the drive."""
        judged = self._judge.judge(frame)
        if judged is None:
            return None
        outcome = self.outcome
        outcome.not_ok += not judged.seen.ok
        outcome.would_hold += judged.would_hold
        if judged.seen.adopted is not None:
            outcome.matches.append(number)
        if judged.opened is not None or judged.would_hold or self._judge.holding:
            outcome.stands(number)
        if judged.opened is not None:
            reasons = tuple(sorted(reason.value for reason in judged.opened.reasons))
            outcome.calls.append(MadeCall(number, frame.at, reasons))
            self._answer(judged.opened, frame)
        return judged.seen

    def _answer(self, call: Call, frame: DriveFrame) -> None:
        try:
            self._judge.answer(self._operator(self._judge, call, frame), frame.at)
        except (CommandError, AnyTraverseError) as error:
            self.outcome.refused.append(f"{frame.name}: {error}")
        self._judge.go_where_uncovered(call.id, frame.at)


class TrialEngine(AnyTraverse):
    """Judges as any engine does, but takes what another trial has made of the same frame.

    Its perceiver is a `StoredPerceiver`. The light depends on the picture alone, maps on the words, the
    region's figures on some settings beside them. Everything else is judged anew.
    """

    _words: tuple[Preferences, Mapping[str, tuple[Example, ...]]] | None = None
    _key: tuple[Any, ...] = ()

    def light_of(self, observation: Observation) -> Light:
        """Return the light that was measured of this picture, or measure it."""
        made: dict[Any, Any] = observation.features.made
        if Light not in made:
            made[Light] = super().light_of(observation)
        light: Light = made[Light]
        return light

    def maps_of(self, observation: Observation) -> Maps | Finding:
        """Return the maps that were made of this frame with these words and weights, or make them."""
        words, examples = self.memory.preferences, self.memory.examples
        if self._words is None or words is not self._words[0] or examples is not self._words[1]:
            self._words = words, examples
            self._key = (tuple(words.items()), *(examples.get(word, ()) for word in words))
        key, made = self._key, observation.features.made
        if key not in made:
            made[key] = super().maps_of(observation)
        maps: Maps | Finding = made[key]
        return maps

    def figures_of(self, observation: Observation, maps: Maps) -> RoiFigures | Finding:
        """Return the figures that were calculated of these maps, or calculate them.

        Of the tile's threshold they depend on whether the worst tile is over it, and on nothing else.
        """
        settings, made = self.settings, observation.features.made
        tile = settings.thresholds.tile
        place = (maps, settings.region, settings.tile_side, settings.corridor, settings.thresholds.margin)
        worst: float | None = made.get(place)
        found: RoiFigures | Finding | None = None
        if worst is not None:
            found = made.get((place, tile is not None and worst > tile))
        if found is None:
            found = super().figures_of(observation, maps)
            if isinstance(found, RoiFigures):
                worst = made[place] = found.worst_tile.uncertainty
                made[place, tile is not None and worst > tile] = found
        return found


def run_trials(trials: Sequence[Trial], frames: Iterable[DriveFrame]) -> list[TrialOutcome]:
    """Judge a drive by all trials, frame after frame."""
    for number, frame in enumerate(frames):
        for trial in trials:
            trial.step(number, frame)
    return [trial.outcome for trial in trials]


class GridError(AnyTraverseError):
    """Reports a grid that cannot be used. The text says what to write."""


@dataclass(frozen=True)
class Grid:
    """Holds the values of each threshold, and regions. tile None: tiles are not judged.

    misfit_allowed: whether the vehicle may be wider than a region, see `Settings`.
    """

    scene: tuple[float, ...]
    roi: tuple[float, ...]
    tile: tuple[float | None, ...]
    regions: tuple[Box, ...]
    misfit_allowed: bool = False

    def combinations(self, base: Settings) -> list[Combination]:
        """Return all combinations. Raises GridError for too many, SettingsError for a number out of range."""
        values = product(self.scene, self.roi, self.tile, self.regions, (self.misfit_allowed,))
        found = [Combination(*one) for one in values]
        if len(self.regions) > MOST_REGIONS:
            raise GridError(f"{len(self.regions)} regions: {MOST_REGIONS} at most can be compared")
        if len(found) > MOST:
            raise GridError(f"{len(found)} combinations: {MOST} at most can be compared")
        for one in found:
            one.applied(base)
        return found


def read_values(text: str, name: str) -> tuple[float, ...]:
    """Read `0.8,0.85,0.9`, or `0.8:0.95:0.05` for values from one to another by a step. Raises GridError."""
    try:
        if ":" in text:
            first, last, step = (float(part) for part in text.split(":"))
            count = round((last - first) / step)
            if not (step > 0 and 0 <= count < MOST):
                raise ValueError
            values = [round(first + number * step, 6) for number in range(count + 1)]
        else:
            values = [float(part) for part in text.split(",")]
    except (ValueError, ZeroDivisionError, OverflowError):
        raise GridError(f'--{name} "{text}": write 0.8,0.85,0.9 or 0.8:0.95:0.05') from None
    return tuple(dict.fromkeys(values))


def read_tiles(text: str) -> tuple[float | None, ...]:
    """Read values as `read_values` does; `off` among them: tiles are not judged. Raises GridError."""
    parts = [part.strip() for part in text.split(",")]
    named = [part for part in parts if part != "off"]
    values: tuple[float | None, ...] = read_values(",".join(named), "tile") if named else ()
    return (*values, None) if len(named) < len(parts) else values


def read_region(text: str) -> Box:
    """Read `0.33,0.6,0.67,0.95`: left, top, right, bottom. Raises GridError, RegionError."""
    try:
        left, top, right, bottom = (float(part) for part in text.split(","))
    except ValueError:
        raise GridError(
            f'--region "{text}": write left,top,right,bottom in fractions of the picture, 0.33,0.6,0.67,0.95'
        ) from None
    return Box(left, top, right, bottom)


def around(settings: Settings) -> Grid:
    """Return a small grid around settings: for a first look, as in the paper's figure."""
    limits = settings.thresholds
    scene = tuple(round(limits.scene + step, 4) for step in (-0.1, -0.05, 0.0) if limits.scene + step >= -1.0)
    roi = tuple(round(min(1.0, limits.roi * factor), 4) for factor in (0.5, 1.0, 1.5))
    return Grid(scene, roi, (limits.tile,), (settings.region.bounds,))
