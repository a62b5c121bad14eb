"""Scores drivable ground on frames as they were filmed, and on the same frames degraded."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace

from anytraverse.errors import AnyTraverseError
from anytraverse.evaluation.datasets import LabelledFrame
from anytraverse.evaluation.degrade import DEGRADATIONS, degraded
from anytraverse.evaluation.drivable import HALF
from anytraverse.evaluation.labels import DatasetError, LabelClasses
from anytraverse.evaluation.scores import Mean, Overlap, Share
from anytraverse.evaluation.seeing import PerceiverRun, stretched, stretched_mask

AS_FILMED = "as filmed"
ALL = "all"


class UnknownDegradationError(AnyTraverseError):
    """Reports a name that no degradation has."""


@dataclass(frozen=True)
class GroundScore:
    """Holds the scores of some frames under one degradation.

    ground, known: as in `DrivableScore`. uncertainty: of the pixels that are labelled drivable; above: the
    share of them with an uncertainty above 0.5.
    """

    ground: Overlap = field(default_factory=Overlap)
    known: Overlap = field(default_factory=Overlap)
    uncertainty: Mean = field(default_factory=Mean)
    above: Share = field(default_factory=lambda: Share(HALF))

    def add(
        self, seeing: PerceiverRun, frame: LabelledFrame, classes: LabelClasses, drivable: Sequence[str]
    ) -> float:
        """Judge a frame and count it. Returns the milliseconds of judging. Raises PerceiverError."""
        seen = seeing.look(frame)
        shape, counted = frame.labels.shape, classes.labelled(frame.labels)
        truth = classes.mask(frame.labels, drivable)
        self.ground.add(frame.number, stretched(seen.maps.traversability, shape) > HALF, truth, counted)
        self.known.add(frame.number, stretched_mask(seen.maps.drivable, shape), truth, counted)
        uncertainty = stretched(seen.maps.uncertainty, shape)[truth]
        self.uncertainty.add(uncertainty)
        self.above.add(uncertainty)
        return seen.milliseconds


def parse_degradations(text: str) -> list[str]:
    """Return the names in a list with commas, each once, in the order given; "all": all of them.

    Raises UnknownDegradationError.
    """
    names = list(dict.fromkeys(name.strip().lower() for name in text.split(",")))
    if names == [ALL]:
        return list(DEGRADATIONS)
    for name in names:
        if name not in DEGRADATIONS:
            raise UnknownDegradationError(
                f'no degradation is called "{name}": give "{ALL}", or of these: {", ".join(DEGRADATIONS)}'
            )
    return names


def score_degraded(
    frames: Iterable[LabelledFrame],
    seeing: PerceiverRun,
    classes: LabelClasses,
    drivable: Sequence[str],
    names: Sequence[str],
) -> tuple[dict[str, GroundScore], list[float]]:
    """Score frames as filmed and under each degradation, against the classes `drivable`.

    Returns the scores, `AS_FILMED` first, and the milliseconds of judging each frame as filmed.
    Raises DatasetError when nothing is labelled drivable; and PerceiverError.
    """
    scores, times = {name: GroundScore() for name in (AS_FILMED, *names)}, []
    for frame in frames:
        times.append(scores[AS_FILMED].add(seeing, frame, classes, drivable))
        for name in names:
            changed = replace(frame, image=degraded(frame.image, name, frame.number))
            scores[name].add(seeing, changed, classes, drivable)
    if not scores[AS_FILMED].above.total:
        raise DatasetError(
            f"no pixel is labelled {' or '.join(drivable)}: name other classes, or more frames"
        )
    return scores, times
