"""Sums the tallies of a run up to its figures."""

from __future__ import annotations

import csv
import io
from collections.abc import Sequence
from dataclasses import dataclass, field
from statistics import median
from typing import Any

import numpy as np
from numpy.typing import NDArray

from anytraverse.evaluation.arguments import rounded
from anytraverse.evaluation.labels import DatasetError
from anytraverse.evaluation.scores import COARSE, Counts, area
from anytraverse.evaluation.tally import HALF, THRESHOLDS, Rows, Tally

Floats = NDArray[np.float64]

THING = 0.01
"""Share of the region of interest that a thing must cover to count as one in it."""


@dataclass(frozen=True)
class FrameScore:
    """Holds the figures of a frame, at a traversability above 0.5. An IoU is None where nothing is drivable.

    iou: over labelled pixels. authors: over all pixels; those without a label count as not drivable.
    known: of what the rover takes for drivable. Shares of the labelled pixels: drivable, found; missed, which
    are drivable and not found; wrong, which are found and not drivable.
    """

    number: int
    name: str
    iou: float | None
    authors: float | None
    known: float | None
    drivable: float
    found: float
    missed: float
    wrong: float


@dataclass
class TallySummary:
    """Adds tallies up. drivable, unknown: names of classes, as `LabelClasses.choose` returns them."""

    rows: Rows
    drivable: Sequence[str]
    unknown: Sequence[str]
    frames: list[FrameScore] = field(default_factory=list)

    def __post_init__(self) -> None:
        names = self.rows.names
        self._true = np.array([name in self.drivable for name in names] + [False])
        self._unknown = np.array([name in self.unknown for name in names] + [False])
        self._false = np.array([name not in self.drivable for name in names] + [False])
        self._ious: list[Floats] = []
        self._authors: list[Floats] = []
        self._times: list[float] = []
        self._ground: Counts = np.zeros((self.rows.count, len(THRESHOLDS) + 1), dtype=np.int64)
        self._known: Counts = np.zeros((self.rows.count, 2), dtype=np.int64)
        self._uncertainty: Counts = np.zeros((self.rows.count, COARSE.count), dtype=np.int64)
        self._clean: list[float] = []
        self._things: list[float] = []

    def add(self, number: int, name: str, tally: Tally) -> None:
        """Add a frame."""
        both, either, unlabelled = self._overlap(tally.ground)
        self._ious.append(_ratio(both, either))
        self._authors.append(_ratio(both, either + unlabelled))
        self._times.append(tally.milliseconds)
        self._ground += tally.ground
        self._known += tally.known
        self._uncertainty += tally.uncertainty
        self._add_roi(tally)
        labelled = max(1, int(tally.ground[:-1].sum()))
        true = int(tally.ground[self._true].sum())
        right = int(both[HALF])
        found = right + int(either[HALF]) - true
        score = FrameScore(
            number,
            name,
            iou=_or_none(self._ious[-1][HALF]),
            authors=_or_none(self._authors[-1][HALF]),
            known=_or_none(_ratio(*self._known_overlap(tally.known))),
            drivable=true / labelled,
            found=found / labelled,
            missed=(true - right) / labelled,
            wrong=(found - right) / labelled,
        )
        self.frames.append(score)

    def _add_roi(self, tally: Tally) -> None:
        """Note the uncertainty of a region of interest that is all drivable, or holds an unknown thing."""
        whole = max(1, int(tally.roi.sum()))
        if tally.roi[self._true].sum() == whole:
            self._clean.append(tally.roi_uncertainty)
        elif tally.roi[self._unknown].sum() >= THING * whole:
            self._things.append(tally.roi_uncertainty)

    def _overlap(self, ground: Counts) -> tuple[Floats, Floats, Floats]:
        """Return intersection, union over labelled pixels, and found pixels without a label, by threshold."""
        found = ground[:, ::-1].cumsum(axis=1)[:, ::-1][:, 1:].astype(np.float64)
        either = ground[self._true].sum() + found[self._false].sum(axis=0)
        return found[self._true].sum(axis=0), either, found[-1]

    def _known_overlap(self, known: Counts) -> tuple[Floats, Floats]:
        both = known[self._true, 1].sum()
        return np.asarray(both, np.float64), np.asarray(known[self._true].sum() + known[self._false, 1].sum())

    def best(self, most: int) -> list[FrameScore]:
        """Return the frames of the highest IoU, the best first."""
        return sorted(self._scored(), key=lambda frame: (-(frame.iou or 0.0), frame.number))[:most]

    def worst(self, most: int) -> list[FrameScore]:
        """Return the frames of the lowest IoU, the worst first."""
        return sorted(self._scored(), key=lambda frame: (frame.iou or 0.0, frame.number))[:most]

    def _scored(self) -> list[FrameScore]:
        return [frame for frame in self.frames if frame.iou is not None]

    def figures(self, most: int) -> dict[str, Any]:
        """Return all figures for JSON, and `most` of the best and of the worst frames.

        Raises DatasetError when nothing is drivable by the labels nor by the maps.
        """
        both, either, _ = self._overlap(self._ground)
        if not self.frames or np.isnan(_ratio(both, either)[HALF]):
            raise DatasetError(
                "no pixel is labelled drivable or found so: name other classes with --drivable"
            )
        known = [frame.known for frame in self.frames if frame.known is not None]
        return {
            "iou_authors": _rounded(_mean(self._authors)[HALF]),
            "iou_mean": _rounded(_mean(self._ious)[HALF]),
            "iou_pooled": _rounded(_ratio(both, either)[HALF]),
            "iou_known_mean": rounded(float(np.mean(known)) if known else None),
            "iou_known_pooled": _rounded(_ratio(*self._known_overlap(self._known))),
            "images": len(self.frames),
            "ms_per_frame": round(median(self._times), 2),
            "curve": self._curve(),
            "classes": self._classes(),
            **self._unknown_figures(),
            "calls": self._calls(),
            "best": [_brief(frame) for frame in self.best(most)],
            "worst": [_brief(frame) for frame in self.worst(most)],
        }

    def _curve(self) -> list[dict[str, float | None]]:
        both, either, _ = self._overlap(self._ground)
        true = self._ground[self._true].sum()
        columns: dict[str, Floats] = {
            "threshold": np.array(THRESHOLDS),
            "iou_authors": _mean(self._authors),
            "iou_mean": _mean(self._ious),
            "iou_pooled": _ratio(both, either),
            "precision": _ratio(both, both + either - true),
            "recall": _ratio(both, np.full_like(both, true)),
        }
        frames = np.count_nonzero(~np.isnan(np.array(self._ious).reshape(-1, len(THRESHOLDS))), axis=0)
        return [
            {
                **{name: _rounded(values[step]) for name, values in columns.items()},
                "frames": int(frames[step]),
            }
            for step in range(len(THRESHOLDS))
        ]

    def _classes(self) -> dict[str, dict[str, Any]]:
        """Return for each class that has pixels which share of them is judged as its labels say."""
        found = self._ground[:, HALF + 1 :].sum(axis=1)
        pixels = self._ground.sum(axis=1)
        return {
            name: {
                "drivable": bool(self._true[row]),
                "pixels": int(pixels[row]),
                "recall": rounded(
                    float((found[row] if self._true[row] else pixels[row] - found[row]) / pixels[row])
                ),
            }
            for row, name in enumerate(self.rows.names)
            if pixels[row]
        }

    def _unknown_figures(self) -> dict[str, Any]:
        chosen = {name: row for row, name in enumerate(self.rows.names) if name in self.unknown}
        ground = self._uncertainty[self._true].sum(axis=0)
        things = self._uncertainty[sorted(chosen.values())].sum(axis=0)
        return {
            "auroc": rounded(area(things, ground)),
            "drivable_above_half": rounded(_above_half(ground)),
            "unknown_above_half": rounded(_above_half(things)),
            "pixels": {"unknown": int(things.sum()), "drivable": int(ground.sum())},
            "unknown": {
                name: {
                    "auroc": rounded(area(self._uncertainty[row], ground)),
                    "pixels": int(self._uncertainty[row].sum()),
                }
                for name, row in chosen.items()
            },
        }

    def _calls(self) -> dict[str, Any]:
        """Return the shares of frames whose region of interest is more uncertain than each threshold."""
        kinds = {"clean": self._clean, "things": self._things}
        curve: list[dict[str, float | None]] = []
        for threshold in THRESHOLDS:
            above = {
                kind: rounded(float(np.mean(np.array(values) > threshold))) if values else None
                for kind, values in kinds.items()
            }
            curve.append({"threshold": threshold, **above})
        return {**{kind: len(values) for kind, values in kinds.items()}, "curve": curve}

    def frames_csv(self) -> str:
        """Return the figures of each frame as CSV, by number."""
        return as_csv([vars(frame) for frame in sorted(self.frames, key=lambda frame: frame.number)])

    def curve_csv(self) -> str:
        """Return the curve over thresholds as CSV."""
        return as_csv(self._curve())


def _brief(frame: FrameScore) -> dict[str, Any]:
    return {"frame": frame.number, "name": frame.name, "iou": rounded(frame.iou)}


def _ratio(part: Floats, whole: Floats) -> Floats:
    """Return part / whole, NaN where whole is 0."""
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.where(whole > 0, part / whole, np.nan)


def _mean(ious: Sequence[Floats]) -> Floats:
    """Return the mean at each threshold over the frames that have an IoU there; NaN without any."""
    table = np.array(ious).reshape(-1, len(THRESHOLDS))
    return _ratio(np.nansum(table, axis=0), np.count_nonzero(~np.isnan(table), axis=0).astype(np.float64))


def _above_half(counts: Counts) -> float | None:
    total = int(counts.sum())
    return int(counts[COARSE.half + 1 :].sum()) / total if total else None


def _or_none(value: Floats | float) -> float | None:
    return None if np.isnan(value) else float(value)


def _rounded(value: Floats | float) -> float | None:
    return rounded(_or_none(value))


def as_csv(rows: Sequence[dict[str, Any]]) -> str:
    """Return rows of the same keys as CSV. Raises IndexError without any."""
    text = io.StringIO()
    writer = csv.DictWriter(text, list(rows[0]), lineterminator="\n")
    writer.writeheader()
    writer.writerows(
        {key: round(value, 6) if isinstance(value, float) else value for key, value in row.items()}
        for row in rows
    )
    return text.getvalue()
