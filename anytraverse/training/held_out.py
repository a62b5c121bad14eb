"""A fit and the network that it would replace, compared on drives that the fit was not trained on."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from anytraverse.perception.builtin.network import Calibration
from anytraverse.training.calibration import calibrated
from anytraverse.training.classes import DRIVABLE, UNKNOWN
from anytraverse.training.folders import BLOCK, Folder
from anytraverse.training.scores import SCALE, Network, Score, auroc, maps, outputs, score
from anytraverse.training.unknowns import paste_unknowns

Model = tuple[Network, Calibration]

FORGETS = 0.03
"""How much less than before the AUROC of things without a name may be."""
_SEED = 8  # of the things that are pasted: the same for both


@dataclass(frozen=True)
class Drive:
    """Scores of the fit and of what it would replace on the same frames, of one block or (None) of all."""

    block: int | None
    images: int
    fitted: Score
    replaced: Score

    @property
    def name(self) -> str:
        """Its numbers."""
        return "all" if self.block is None else f"{self.block * BLOCK:04d}-{(self.block + 1) * BLOCK - 1:04d}"


@dataclass(frozen=True)
class Comparison:
    """Each drive, all of them, and what the refusal goes by.

    recalibrated: IoU of the replaced network when bias and gamma are fitted to these drives, where the fit's
    were; else None. things, things_before: AUROC of uncertainty, pasted things without a name against
    drivable ground.
    """

    drives: tuple[Drive, ...]
    all: Drive
    recalibrated: float | None
    things: float
    things_before: float

    @property
    def before(self) -> float:
        """The drivable IoU to keep: of the replaced network as it is, or calibrated on these drives."""
        return max(self.all.replaced.iou, self.recalibrated or 0.0)

    @property
    def calibrating_helps(self) -> bool:
        """The replaced network would be better with its bias and gamma fitted to these drives."""
        return self.recalibrated is not None and self.recalibrated > self.all.replaced.iou

    def refusal(self) -> str | None:
        """Why the fit is worse than what it would replace, or None."""
        if self.all.fitted.iou < self.before:
            return f"drivable IoU {self.all.fitted.iou:.3f}, before {self.before:.3f}"
        if self.things < self.things_before - FORGETS:
            return f"AUROC of unknown things {self.things:.3f}, before {self.things_before:.3f}"
        return None

    def table(self) -> list[str]:
        """For people: a line for each drive, one for all, and what else counts."""
        lines = [f"  {'drive':12}{'images':>6}{'IoU':>8}{'before':>8}{'uncertain':>11}{'before':>8}"]
        for drive in (*self.drives, self.all):
            new, old = drive.fitted, drive.replaced
            lines.append(
                f"  {drive.name:12}{drive.images:6}{new.iou:8.3f}{old.iou:8.3f}"
                f"{new.unexplained:11.3f}{old.unexplained:8.3f}"
            )
        if self.recalibrated is not None:
            lines.append(f"    before, calibrated on these drives: IoU {self.recalibrated:.3f}")
        lines.append(f"    things without a name: AUROC {self.things:.3f}, before {self.things_before:.3f}")
        return lines

    def figures(self) -> dict[str, Any]:
        """For JSON."""
        return {
            **_figures(self.all),
            "iou_replaced_recalibrated": None if self.recalibrated is None else round(self.recalibrated, 4),
            "things_auroc": round(self.things, 4),
            "things_auroc_replaced": round(self.things_before, 4),
            "drives": [{"drive": drive.name} | _figures(drive) for drive in self.drives],
        }


def compare(fitted: Model, replaced: Model, folder: Folder, *, chosen_here: bool) -> Comparison:
    """Both on the frames of a folder; `chosen_here`: the fit's calibration was chosen on them."""
    new, old = (outputs(network, folder) for network, _ in (fitted, replaced))
    blocks = [frame.number // BLOCK for frame in folder.frames]

    def drive(block: int | None) -> Drive:
        chosen = [index for index, own in enumerate(blocks) if block is None or own == block]
        scores = (
            score([results[index] for index in chosen], calibration)
            for results, (_, calibration) in zip((new, old), (fitted, replaced), strict=True)
        )
        return Drive(block, len(chosen), *scores)

    again = score(old, calibrated(replaced[0], folder, replaced[1])).iou if chosen_here else None
    return Comparison(
        tuple(drive(block) for block in folder.blocks),
        drive(None),
        again,
        things_auroc(fitted, folder),
        things_auroc(replaced, folder),
    )


def things_auroc(model: Model, folder: Folder) -> float:
    """How uncertainty tells made shapes pasted into the frames from drivable ground."""
    network, calibration = model
    rng = np.random.default_rng(_SEED)
    doubts, things = [], []
    for frame in folder.frames:
        image, labels = paste_unknowns(frame.image, frame.labels, rng)
        names = labels[::SCALE, ::SCALE]
        _, uncertainty = maps(network(image)[0], calibration, names.shape)
        judged = (names == UNKNOWN) | np.isin(names, DRIVABLE)
        doubts.append(uncertainty[judged])
        things.append(names[judged] == UNKNOWN)
    return auroc(np.concatenate(doubts), np.concatenate(things))


def _figures(drive: Drive) -> dict[str, Any]:
    return {
        "images": drive.images,
        "iou_pooled": round(drive.fitted.iou, 4),
        "iou_replaced": round(drive.replaced.iou, 4),
        "uncertain": round(drive.fitted.unexplained, 4),
        "uncertain_replaced": round(drive.replaced.unexplained, 4),
    }
