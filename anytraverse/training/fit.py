"""One fit from frames to files: training, calibration, scores, comparison with what it would replace."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from anytraverse.errors import TrainingError
from anytraverse.frame import Image
from anytraverse.perception.ground_net import Calibration, network_input
from anytraverse.perception.runtime import Runtime, open_session
from anytraverse.training.calibration import calibrated, plain, tap_background
from anytraverse.training.export import INPUT, OUTPUTS, as_network, export
from anytraverse.training.fitting import Options, Progress, train
from anytraverse.training.folders import Folder, Split
from anytraverse.training.net import FEATURES, GroundNet
from anytraverse.training.scenes import cosines, fitted_scene, scene_auroc
from anytraverse.training.scores import VIEWS, Floats, Network, Score, class_ranks, outputs, score


@dataclass(frozen=True)
class Scores:
    """What held-out frames say of a network.

    by_view: scores in the lights of `VIEWS`. ranks: AUROC of each class. scene: AUROC of revisits.
    """

    by_view: dict[str, Score]
    ranks: dict[str, float]
    scene: float

    @property
    def iou(self) -> float:
        """Drivable IoU at 0.5, pooled, in the light the frames were filmed in."""
        return next(iter(self.by_view.values())).iou

    def lines(self) -> list[str]:
        """The same for people."""
        told = [
            f"{view}: drivable IoU {one.iou:.3f}, by frame {one.iou_mean:.3f}; unknown {one.unexplained:.3f}"
            for view, one in self.by_view.items()
        ]
        told.append("AUROC by class: " + ", ".join(f"{name} {rank:.3f}" for name, rank in self.ranks.items()))
        told.append(f"AUROC of revisits against other drives: {self.scene:.4f}")
        return told


@dataclass(frozen=True, eq=False)
class Fitted:
    """A trained and calibrated network, with its scores on validation and, where held out, test frames."""

    net: GroundNet
    calibration: Calibration
    validation: Scores
    test: Scores | None


def fit(
    real: Folder, made: Folder, split: Split, options: Options, progress: Progress | None = None
) -> Fitted:
    """Train on all blocks but those of `split`, calibrate on validation. Raises TrainingError."""
    training, validation, test = split.parts(real)
    net = train(training, made, options, progress)
    calibration = calibrate(as_network(net), training, made, validation, options.seed)
    network = as_network(net)
    tested = scores(network, calibration, test, training) if len(test) else None
    return Fitted(net, calibration, scores(network, calibration, validation, training), tested)


def calibrate(network: Network, training: Folder, made: Folder, validation: Folder, seed: int) -> Calibration:
    """All numbers beside a network."""
    mean, whitening = tap_background(network, validation)
    start = replace(plain(FEATURES), tap_mean=mean, tap_whitening=whitening)
    return fitted_scene(network, training, made, validation, calibrated(network, validation, start), seed)


def scores(network: Network, calibration: Calibration, folder: Folder, others: Folder) -> Scores:
    """Scores on frames that it was not trained on; `others` are drives that these are no revisits of."""
    by_view = {name: score(outputs(network, folder, gains), calibration) for name, gains in VIEWS.items()}
    ranks = class_ranks(outputs(network, folder), calibration)
    same, other = cosines(network, folder, others, calibration, np.random.default_rng(5))
    return Scores(by_view, ranks, scene_auroc(same, other))


def write(fitted: Fitted, path: Path) -> None:
    """The network at `path`, ending in .onnx, and its calibration beside it, ending in .npz."""
    if path.suffix != ".onnx":
        raise TrainingError(f"{path.name}: a network's file ends in .onnx")
    export(fitted.net, path)
    fitted.calibration.save(path.with_suffix(".npz"))


def stored(path: Path) -> tuple[Network, Calibration]:
    """A network and calibration that were written before. Raises PerceiverError."""
    session = open_session(path, Runtime(threads=1))

    def run(image: Image) -> tuple[Floats, Floats]:
        logits, features = session.run(list(OUTPUTS), {INPUT: network_input(image)})
        return logits[0], features[0]

    return run, Calibration.load(path.with_suffix(".npz"))


def refuse_worse(fitted: Fitted, replaced: Sequence[Scores]) -> None:
    """Raises TrainingError when a fit is worse on its validation frames than one that it would replace."""
    for old in replaced:
        if fitted.validation.iou < old.iou:
            raise TrainingError(
                f"the fit is worse than what it would replace (drivable IoU {fitted.validation.iou:.3f}, "
                f"{old.iou:.3f} before, on the frames held out): nothing was written. More drives, more "
                "steps or another seed may help"
            )
