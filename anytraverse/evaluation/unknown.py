"""Scores how well the uncertainty map tells things without a word from drivable ground."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from statistics import median

from anytraverse.evaluation.datasets import LabelledFrame
from anytraverse.evaluation.labels import Classes, DatasetError
from anytraverse.evaluation.scores import Ranking, Share
from anytraverse.evaluation.seeing import PerceiverRun, stretched

HALF = 0.5
"""The uncertainty above which no word explains a pixel."""


@dataclass(frozen=True)
class UnknownScore:
    """Holds the scores of some frames.

    together: ranking of the uncertainty of all unknown classes against drivable ground; classes: of each one.
    drivable_above, unknown_above: shares of drivable and of unknown pixels with an uncertainty above 0.5.
    milliseconds: median time of encoding, attending and pooling.
    """

    images: int
    together: Ranking
    classes: dict[str, Ranking]
    drivable_above: Share
    unknown_above: Share
    milliseconds: float


def score_unknown(
    frames: Iterable[LabelledFrame],
    seeing: PerceiverRun,
    classes: Classes,
    unknown: Sequence[str],
    drivable: Sequence[str],
) -> UnknownScore:
    """Score the uncertainty on the classes `unknown` against the classes `drivable`.

    Raises DatasetError when no pixel is labelled unknown, or none drivable; and PerceiverError.
    """
    together, each = Ranking(), {name: Ranking() for name in unknown}
    drivable_above, unknown_above, times = Share(HALF), Share(HALF), []
    for frame in frames:
        seen = seeing.look(frame)
        times.append(seen.milliseconds)
        uncertainty = stretched(seen.maps.uncertainty, frame.labels.shape)
        ground = uncertainty[classes.mask(frame.labels, drivable)]
        things = uncertainty[classes.mask(frame.labels, unknown)]
        drivable_above.add(ground)
        unknown_above.add(things)
        together.add(things, ground)
        for name, ranking in each.items():
            ranking.add(uncertainty[classes.mask(frame.labels, [name])], ground)
    for names, pixels in ((unknown, together.positives), (drivable, together.negatives)):
        if not pixels:
            raise DatasetError(
                f"no pixel is labelled {' or '.join(names)}: name other classes, or more frames"
            )
    return UnknownScore(len(times), together, each, drivable_above, unknown_above, median(times))
