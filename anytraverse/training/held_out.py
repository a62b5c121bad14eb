"""Compares a fit with the network that it would replace, on drives that the fit was not trained on."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from anytraverse.perception.builtin.calibration import Calibration
from anytraverse.training.classes import DRIVABLE, UNKNOWN
from anytraverse.training.cutouts import Cutout
from anytraverse.training.folders import BLOCK, Folder
from anytraverse.training.joint import recalibrated
from anytraverse.training.scores import SCALE, Network, Score, auroc, maps, outputs, score
from anytraverse.training.things import ENOUGH, recall, seen
from anytraverse.training.unknowns import paste_unknowns

Model = tuple[Network, Calibration]

FORGETS = 0.03
"""How much lower than before the AUROC of things without a name may be."""
LOSES = 0.03
"""How much lower the share of pasted things that a rover notices may be than before, or than `ENOUGH`."""
_SEED = 8  # for pasting things, so that both networks see the same ones


@dataclass(frozen=True)
class DriveScores:
    """Holds the scores of the fit and of the replaced network on the frames of one block; None: of all."""

    block: int | None
    images: int
    fitted: Score
    replaced: Score

    @property
    def name(self) -> str:
        """The range of its numbers."""
        return "all" if self.block is None else f"{self.block * BLOCK:04d}-{(self.block + 1) * BLOCK - 1:04d}"


@dataclass(frozen=True)
class HeldOutComparison:
    """Holds the scores of each drive and of all, and the figures by which a fit is refused.

    recalibrated: IoU of the replaced network with bias and limits fitted to these drives; None where those of
    the fit were not fitted to them. things, things_before: AUROC of uncertainty, pasted things without a name
    against drivable ground, of the fit and of the replaced network. noticed, noticed_before: their share of
    `pasted` things on the ground to be driven that a rover would notice, NaN without any;
    noticed_recalibrated: that of the replaced network as for `recalibrated`.
    """

    drives: tuple[DriveScores, ...]
    all: DriveScores
    recalibrated: float | None
    things: float
    things_before: float
    pasted: int
    noticed: float
    noticed_before: float
    noticed_recalibrated: float | None

    @property
    def before(self) -> float:
        """The drivable IoU to reach: of the replaced network as it is, or calibrated on these drives."""
        return max(self.all.replaced.iou, self.recalibrated or 0.0)

    @property
    def calibrating_helps(self) -> bool:
        """Whether the replaced network is better with its bias and limits fitted to these drives."""
        return (
            self.recalibrated is not None
            and self.noticed_recalibrated is not None
            and self.recalibrated > self.all.replaced.iou
            and self.noticed_recalibrated >= min(ENOUGH, self.noticed_before) - LOSES
        )

    def refusal(self) -> str | None:
        """Return why the fit is worse than the network it would replace, or None."""
        if not self.noticed >= min(ENOUGH, self.noticed_before) - LOSES:  # NaN is a refusal
            return (
                f"a rover would notice {self.noticed:.3f} of {self.pasted} pasted things, "
                f"before {self.noticed_before:.3f}"
            )
        if self.all.fitted.iou < self.before:
            return f"drivable IoU {self.all.fitted.iou:.3f}, before {self.before:.3f}"
        if self.things < self.things_before - FORGETS:
            return f"AUROC of unknown things {self.things:.3f}, before {self.things_before:.3f}"
        return None

    def table(self) -> list[str]:
        """Return a table for a person: a line for each drive, one for all, and the other figures."""
        lines = [f"  {'drive':12}{'images':>6}{'IoU':>8}{'before':>8}{'uncertain':>11}{'before':>8}"]
        for drive in (*self.drives, self.all):
            new, old = drive.fitted, drive.replaced
            lines.append(
                f"  {drive.name:12}{drive.images:6}{new.iou:8.3f}{old.iou:8.3f}"
                f"{new.unexplained:11.3f}{old.unexplained:8.3f}"
            )
        if self.recalibrated is not None:
            lines.append(f"    before, calibrated on these drives: IoU {self.recalibrated:.3f}")
        lines.append(
            f"    {self.pasted} pasted things: {self.noticed:.3f} noticed, before {self.noticed_before:.3f}"
        )
        lines.append(f"    things without a name: AUROC {self.things:.3f}, before {self.things_before:.3f}")
        return lines

    def figures(self) -> dict[str, Any]:
        """Return the figures for JSON."""
        return {
            **_figures(self.all),
            "iou_replaced_recalibrated": None if self.recalibrated is None else round(self.recalibrated, 4),
            "things_pasted": self.pasted,
            "things_noticed": _number(self.noticed),
            "things_noticed_replaced": _number(self.noticed_before),
            "things_auroc": round(self.things, 4),
            "things_auroc_replaced": round(self.things_before, 4),
            "drives": [{"drive": drive.name} | _figures(drive) for drive in self.drives],
        }


def compare(
    fitted: Model, replaced: Model, folder: Folder, cutouts: Sequence[Cutout] = (), *, chosen_here: bool
) -> HeldOutComparison:
    """Compare both on the frames of a folder; chosen_here: the fit's calibration was chosen on them.

    A calibration chosen on these frames is an advantage: the replaced network is then calibrated on them too.
    cutouts: photographs of things that are pasted beside made ones. The things are not those by which the
    limits were chosen.
    """
    new, old = (outputs(network, folder) for network, _ in (fitted, replaced))
    blocks = [frame.number // BLOCK for frame in folder.frames]

    def drive(block: int | None) -> DriveScores:
        chosen = [index for index, own in enumerate(blocks) if block is None or own == block]
        scores = (
            score([results[index] for index in chosen], calibration)
            for results, (_, calibration) in zip((new, old), (fitted, replaced), strict=True)
        )
        return DriveScores(block, len(chosen), *scores)

    new_things, old_things = (seen(network, folder, _SEED, cutouts) for network, _ in (fitted, replaced))
    again = recalibrated(replaced[0], folder, replaced[1], cutouts) if chosen_here else None
    return HeldOutComparison(
        tuple(drive(block) for block in folder.blocks),
        drive(None),
        score(old, again).iou if again else None,
        things_auroc(fitted, folder),
        things_auroc(replaced, folder),
        len(new_things),
        recall(new_things, fitted[1]),
        recall(old_things, replaced[1]),
        recall(old_things, again) if again else None,
    )


def things_auroc(model: Model, folder: Folder) -> float:
    """Calculate the AUROC of uncertainty for pasted artificial things against drivable ground."""
    network, calibration = model
    rng = np.random.default_rng(_SEED)
    doubts, things = [], []
    for frame in folder.frames:
        image, labels = paste_unknowns(frame.image, frame.labels, rng)
        names = labels[::SCALE, ::SCALE]
        _, uncertainty = maps(network(image), calibration, names.shape)
        judged = (names == UNKNOWN) | np.isin(names, DRIVABLE)
        doubts.append(uncertainty[judged])
        things.append(names[judged] == UNKNOWN)
    return auroc(np.concatenate(doubts), np.concatenate(things))


def _number(share: float) -> float | None:
    """Return a share for JSON, which has no NaN."""
    return None if math.isnan(share) else round(share, 4)


def _figures(drive: DriveScores) -> dict[str, Any]:
    return {
        "images": drive.images,
        "iou_pooled": round(drive.fitted.iou, 4),
        "iou_replaced": round(drive.replaced.iou, 4),
        "uncertain": round(drive.fitted.unexplained, 4),
        "uncertain_replaced": round(drive.replaced.unexplained, 4),
    }
