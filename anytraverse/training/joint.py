"""Fits bias, limits of strangeness and the tile's threshold together, by what a rover would do with them.

The outputs of the network are kept, and judged at every point of a grid by the code that judges on the rover.
A point is chosen by what all drives but one say; what it does on that one is reported.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import product

import numpy as np
from numpy.typing import NDArray

from anytraverse.assessment import NAMED_TILE, WORST_TILE, Maps, Observation
from anytraverse.engine import AnyTraverse
from anytraverse.frame import Frame, Image
from anytraverse.judging import Settings
from anytraverse.memory import first_memory
from anytraverse.perception.builtin.attention import distance, posteriors
from anytraverse.perception.builtin.calibration import Calibration, Floats
from anytraverse.perception.builtin.network import Outputs
from anytraverse.perception.builtin.perceiver import GroundNetwork, GroundOutputs
from anytraverse.preferences import Preferences
from anytraverse.training.classes import CLASSES, DRIVABLE, UNLABELLED
from anytraverse.training.cutouts import Cutout
from anytraverse.training.folders import BLOCK, Folder, Labelled, Labels
from anytraverse.training.scores import SCALE, VIEWS, Network, gained, resized
from anytraverse.training.things import ENOUGH, seen, worst_on

WORDS = Preferences.parse("trail: 1; grass: 1; bush: -1; tree: -1; water: -1; sky: -1")
"""A word for every class with a name."""
BIASES = (-0.5, -0.25, 0.0, 0.25, 0.5)
"""Added to the logits of the drivable classes."""
LIMITS = (0.1, 1.4)
"""Limits of the probability of a thing and of the distance, before the factor."""
FACTORS = tuple(2 ** (step / 6) for step in range(-5, 6))
TILES = (0.45, 0.5, 0.55, 0.6, 0.65, 0.7, 0.75, 0.8, 0.85, 0.9)
FRONTIER = (0.9, 0.92, 0.93, 0.94, 0.95, 0.96)
"""Required recalls for which `Outcomes.frontier` has a row."""
_LUCK = 0.005  # difference of IoU less false stops that is luck between drives
_RELIT = 4  # every so many frames one is also judged in another light
_SEED = 9  # of the pasted things

Numbers = NDArray[np.float64]


@dataclass(frozen=True)
class _Outcome:
    """Holds what a rover does on some drives: counts of pixels, of clean frames and of pasted things."""

    overlap: float
    union: float
    stopped: int
    clean: int
    noticed: int
    things: int

    def __add__(self, other: _Outcome) -> _Outcome:
        """Add the counts of other drives."""
        return _Outcome(*(a + b for a, b in zip(vars(self).values(), vars(other).values(), strict=True)))

    def __str__(self) -> str:
        return (
            f"drivable IoU {self.overlap / max(self.union, 1):.3f}, clean frames stopped "
            f"{self.stopped}/{self.clean}, things noticed {self.noticed}/{self.things}"
        )

    def as_json(self) -> dict[str, float | int]:
        """Return the figures for JSON."""
        return {
            "iou": round(self.overlap / max(self.union, 1), 4),
            "stopped": int(self.stopped),
            "clean": int(self.clean),
            "noticed": int(self.noticed),
            "things": int(self.things),
        }


@dataclass(frozen=True, eq=False)
class Outcomes:
    """Holds what every calibration of the grid does on n frames and m things.

    rows: g calibrations without a tile's threshold. overlap, union, worst, otherwise (g, n): pixels found and
    drivable, and found or drivable; the worst tile; whether the frame is not OK whatever that tile is. clean,
    drives, filmed (n,): of the frames; filmed is False in a changed light. values (g, m): the worst tile on
    each thing. of (m,): its drive.
    """

    rows: tuple[Calibration, ...]
    tiles: tuple[float, ...]
    overlap: Numbers
    union: Numbers
    worst: Numbers
    otherwise: NDArray[np.bool_]
    clean: NDArray[np.bool_]
    filmed: NDArray[np.bool_]
    drives: NDArray[np.intp]
    values: Numbers
    of: NDArray[np.intp]

    def choose(self, required: float, without: int | None = None) -> tuple[int, int]:
        """Choose row and tile: the highest drivable IoU less the share of clean frames that are stopped.

        At least `required` of the things must be noticed, or as many as any choice notices. Of those that
        differ by luck, the one with the smallest bias that notices most. without: the drive that has no say.
        """
        kept, things = self.drives != without, self.of != without
        clean = kept & self.clean
        iou = self.overlap[:, kept].sum(axis=1) / np.maximum(self.union[:, kept].sum(axis=1), 1.0)
        merit, recall = np.empty((2, len(self.rows), len(self.tiles)))
        for at, tile in enumerate(self.tiles):
            bad = self.otherwise[:, clean] | (self.worst[:, clean] > tile)
            merit[:, at] = iou - bad.sum(axis=1) / max(clean.sum(), 1)
            recall[:, at] = (self.values[:, things] > tile).sum(axis=1) / max(things.sum(), 1)
        merit[recall < min(required, float(recall.max()))] = -np.inf
        as_good = merit > merit.max() - _LUCK
        biases = np.array([abs(row.bias[DRIVABLE[0]]) for row in self.rows])
        as_good &= (biases == biases[as_good.any(axis=1)].min())[:, np.newaxis]
        row, column = np.unravel_index(int(np.argmax(np.where(as_good, recall, -1.0))), recall.shape)
        return int(row), int(column)

    def calibration(self, choice: tuple[int, int]) -> Calibration:
        """Return the calibration of a choice."""
        return replace(self.rows[choice[0]], tile=float(self.tiles[choice[1]]))

    def outcome(self, choice: tuple[int, int], drive: int) -> _Outcome:
        """Return what a choice does on the frames of a drive as they were filmed, and on its things."""
        row, tile = choice[0], self.tiles[choice[1]]
        own, things = (self.drives == drive) & self.filmed, self.of == drive
        clean = own & self.clean
        bad = self.otherwise[row, clean] | (self.worst[row, clean] > tile)
        return _Outcome(
            float(self.overlap[row, own].sum()),
            float(self.union[row, own].sum()),
            int(bad.sum()),
            int(clean.sum()),
            int((self.values[row, things] > tile).sum()),
            int(things.sum()),
        )

    def left_out(self, required: float) -> dict[int, _Outcome]:
        """Return for each drive what the choice of all others does on it."""
        return {
            int(drive): self.outcome(self.choose(required, int(drive)), int(drive))
            for drive in np.unique(self.drives)
        }

    def frontier(self) -> dict[float, _Outcome]:
        """Return for each required recall what is reached on the drives that were left out, in all."""
        nothing = _Outcome(0.0, 0.0, 0, 0, 0, 0)
        return {required: sum(self.left_out(required).values(), nothing) for required in FRONTIER}


def judged(network: Network, folder: Folder, start: Calibration, cutouts: Sequence[Cutout] = ()) -> Outcomes:
    """Judge the frames of a folder, and things pasted into them, at every point of the grid and at `start`.

    The frames of one drive alone are split into its first and its second half.
    """
    parts = [folder.of([block], gap=0) for block in folder.blocks]
    if len(parts) == 1:
        middle = len(folder) // 2
        parts = [Folder(folder.frames[:middle]), Folder(folder.frames[middle:])]
    names = [part.frames[0].number // BLOCK if len(folder.blocks) > 1 else n for n, part in enumerate(parts)]
    views = [view for name, part in zip(names, parts, strict=True) for view in _views(network, part, name)]
    things = [
        (name, thing)
        for name, part in zip(names, parts, strict=True)
        for thing in seen(network, part, _SEED, cutouts, len(parts))
    ]
    rows = (*(_row(start, bias, factor) for bias, factor in product(BIASES, FACTORS)), start)
    fars = [distance(view.outputs, start) for view in views]
    thing_fars = [distance(thing.outputs, start) for _, thing in things]
    shape = len(rows), len(views)
    overlap, union, worst = np.zeros((3, *shape))
    otherwise, values = np.zeros(shape, dtype=np.bool_), np.zeros((len(rows), len(things)))
    for at, row in enumerate(rows):
        judge = _Judge(row)
        for n, (view, far) in enumerate(zip(views, fars, strict=True)):
            overlap[at, n], union[at, n], worst[at, n], otherwise[at, n] = judge.view(view, far)
        for n, ((_, thing), far) in enumerate(zip(things, thing_fars, strict=True)):
            values[at, n] = worst_on(thing, judge.maps(thing.outputs, far).uncertainty)
    return Outcomes(
        rows,
        (*TILES, start.tile),
        overlap,
        union,
        worst,
        otherwise,
        np.array([view.clean for view in views], dtype=np.bool_),
        np.array([view.filmed for view in views], dtype=np.bool_),
        np.array([view.drive for view in views], dtype=np.intp),
        values,
        np.array([name for name, _ in things], dtype=np.intp),
    )


def recalibrated(
    network: Network,
    validation: Folder,
    start: Calibration,
    cutouts: Sequence[Cutout] = (),
    required: float | None = None,
) -> Calibration:
    """Fit bias, limits and tile together. required: the recall of things; None: as much as with `start`.

    No more than `ENOUGH` is required either way.
    """
    found = judged(network, validation, start, cutouts)
    if required is None:
        before = (found.values[-1] > start.tile).mean() if len(found.of) else 0.0
        required = float(before)
    return found.calibration(found.choose(min(ENOUGH, required)))


@dataclass(frozen=True, eq=False)
class _View:
    """Holds the network's outputs for a frame, without `features`, and its labels at `SCALE`."""

    outputs: Outputs
    image: Image
    labels: Labels
    drive: int
    clean: bool
    filmed: bool


def _views(network: Network, part: Folder, drive: int) -> Iterator[_View]:
    """Run the network on the frames as filmed, and on some of them in another light."""
    lights = list(VIEWS.values())
    for index, frame in enumerate(part.frames):
        gains = [lights[0]]
        if index % _RELIT == 0 and len(lights) > 1:
            gains.append(lights[1 + index // _RELIT % (len(lights) - 1)])
        for one in gains:
            outputs = network(gained(frame.image, one))
            kept = outputs._replace(features=outputs.features[:0])
            labels = frame.labels[::SCALE, ::SCALE]
            yield _View(kept, frame.image, labels, drive, _is_clean(frame), one == lights[0])


def _is_clean(frame: Labelled) -> bool:
    inside = frame.labels[Settings().region.mask(*frame.labels.shape)]
    return bool(np.isin(inside, DRIVABLE).all())


def _row(start: Calibration, raised: float, factor: float) -> Calibration:
    bias = np.zeros(len(CLASSES), dtype=np.float32)
    bias[list(DRIVABLE)] = raised
    return replace(start, bias=bias, limits=np.array(LIMITS, dtype=np.float32) * np.float32(factor))


class _Stored(GroundNetwork):
    """Perceives from outputs that the network made before."""

    def __init__(self, calibration: Calibration) -> None:
        self._calibration = calibration
        self.model_id = "fit"
        self.defaults = replace(self.DEFAULTS, tile=1.0)


class _Judge:
    """Judges stored outputs with a calibration as the rover does, but for the tile's threshold."""

    def __init__(self, calibration: Calibration) -> None:
        self._calibration = calibration
        perceiver = _Stored(calibration)
        settings = Settings.of(perceiver.defaults)
        self._engine = AnyTraverse(perceiver, settings, first_memory(perceiver.model_id, WORDS))

    def maps(self, outputs: Outputs, far: Floats) -> Maps:
        """Make the maps of a frame."""
        grey = np.broadcast_to(np.uint8(128), (1, 1, 3))
        found = self._engine.maps_of(self._observation(outputs, far, grey))
        assert isinstance(found, Maps)
        return found

    def view(self, view: _View, far: Floats) -> tuple[float, float, float, bool]:
        """Return pixels found and drivable, found or drivable, the worst tile, and if the rest is bad."""
        seen_once = self._observation(view.outputs, far, view.image)
        result = self._engine.judge(seen_once, 0.0)
        assert result.maps is not None
        ground = resized(result.maps.traversability, view.labels.shape) >= 0.5
        known, true = view.labels != UNLABELLED, np.isin(view.labels, DRIVABLE)
        tiles = [one.value for one in result.findings if one.figure in {WORST_TILE, NAMED_TILE}]
        rest = any(one.bad for one in result.findings if one.figure not in {WORST_TILE, NAMED_TILE})
        overlap, union = (ground & true & known).sum(), ((ground | true) & known).sum()
        return float(overlap), float(union), max(tiles), rest

    def _observation(self, outputs: Outputs, far: Floats, image: Image) -> Observation:
        ground = GroundOutputs(_NO_FRAME, outputs, posteriors(outputs, self._calibration, far))
        return Observation(Frame(0, 0.0, image), ground, _SOMEWHERE)


_NO_FRAME = np.zeros((1, 3, 0, 0), dtype=np.float32)  # it is needed for taps and for words with a colour only
_SOMEWHERE = np.array([1.0, 0.0], dtype=np.float32)
