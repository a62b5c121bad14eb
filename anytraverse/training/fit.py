"""Fits a network to frames: trains, calibrates and scores it, and writes its files."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import torch

from anytraverse.errors import TrainingError
from anytraverse.perception.builtin.calibration import Calibration
from anytraverse.perception.builtin.network import network_input, open_network
from anytraverse.perception.runtime import Runtime
from anytraverse.training.backbone import pretrained
from anytraverse.training.calibration import fitted_distances, plain, tap_background
from anytraverse.training.classes import CLASSES
from anytraverse.training.export import LARGEST, export, read_back
from anytraverse.training.fitting import FitOptions, Material, Progress, train
from anytraverse.training.folders import Folder, Split
from anytraverse.training.joint import recalibrated
from anytraverse.training.net import GroundNet
from anytraverse.training.scenes import cosines, fitted_scene, fitted_surroundings, scene_auroc
from anytraverse.training.scores import VIEWS, Network, class_ranks, outputs, score
from anytraverse.training.things import ENOUGH, recall, seen

_SEED = 9  # of the things that the network before must notice


@dataclass(frozen=True, eq=False)
class Fitted:
    """Holds a trained network, FILE.onnx in a temporary folder, and its calibration."""

    network: Path
    calibration: Calibration

    @property
    def model(self) -> tuple[Network, Calibration]:
        """The network as a function, and its calibration, for scoring."""
        return opened(self.network), self.calibration


def fit(
    material: Material, split: Split, options: FitOptions, folder: Path, progress: Progress | None = None
) -> Fitted:
    """Train from the ImageNet weights on all blocks but those of `split`, calibrate on validation.

    folder: where the network is written. Raises TrainingError.
    """
    training, validation, _ = split.parts(material.real)
    torch.manual_seed(options.seed)
    net = GroundNet()
    net.backbone = pretrained().requires_grad_(requires_grad=False)
    path = _exported(net, replace(material, real=training), options, folder, progress)
    network = opened(path)
    return Fitted(path, calibrate(network, training, material.made, validation, options.seed))


def fit_on(
    start: Path,
    material: Material,
    split: Split,
    options: FitOptions,
    folder: Path,
    progress: Progress | None = None,
) -> Fitted:
    """Train on from a network that a training wrote; with 0 steps only its calibration changes.

    As many pasted things are noticed as before, or `ENOUGH` of them where it were more. The distances, the
    scene's projection and the background of taps stay as they were: few frames of few places would make them
    worse. Raises TrainingError, PerceiverError.
    """
    training, validation, _ = split.parts(material.real)
    network, before = stored(start)
    cutouts = material.kept_cutouts
    path, required = start, None
    if options.steps:
        required = recall(seen(network, validation, _SEED, cutouts), before)
        path = _exported(read_back(start), replace(material, real=training), options, folder, progress)
    return Fitted(path, recalibrated(opened(path), validation, before, cutouts, required))


def _exported(
    net: GroundNet, material: Material, options: FitOptions, folder: Path, progress: Progress | None
) -> Path:
    path = folder / "trained.onnx"
    export(train(net, material, options, progress), path, material.real)
    return path


def calibrate(network: Network, training: Folder, made: Folder, validation: Folder, seed: int) -> Calibration:
    """Fit the whole calibration of a network."""
    mean, whitening = tap_background(network, validation)
    start = fitted_distances(network, training, plain(), seed)
    start = replace(start, tap_mean=mean, tap_whitening=whitening)
    ready = recalibrated(network, validation, start, required=ENOUGH)
    ready = fitted_surroundings(network, training, ready)
    return fitted_scene(network, training, made, validation, ready, seed)


def details(model: tuple[Network, Calibration], folder: Folder, others: Folder) -> list[str]:
    """Return more scores on held-out frames as lines for a person; others: frames of other drives."""
    network, calibration = model
    lights = {name: score(outputs(network, folder, gains), calibration).iou for name, gains in VIEWS.items()}
    ranks = class_ranks(outputs(network, folder), calibration)
    found = [f"{name} {rank:.3f}" for name, rank in ranks.items() if not math.isnan(rank)]
    same, other = cosines(network, folder, others, calibration, np.random.default_rng(5))
    return [
        "drivable IoU " + ", ".join(f"{name} {iou:.3f}" for name, iou in lights.items()),
        "AUROC by class " + ", ".join(found),
        f"AUROC of revisits against other drives {scene_auroc(same, other):.4f}",
    ]


def check_out(path: Path) -> None:
    """Raise TrainingError now where `write` could not write later, after the training."""
    if path.suffix != ".onnx":
        raise TrainingError(f"{path.name}: a network's file ends in .onnx")
    with _temporary_folder_beside(path) as folder_beside:
        (folder_beside / path.name).write_bytes(bytes(2 * LARGEST))


def write(fitted: Fitted, path: Path) -> None:
    """Write the network to `path`, FILE.onnx, and its calibration to FILE.npz, both or neither.

    Raises TrainingError.
    """
    with _temporary_folder_beside(path) as folder_beside:
        network = folder_beside / path.name
        numbers = network.with_suffix(".npz")
        network.write_bytes(fitted.network.read_bytes())
        fitted.calibration.save(numbers)
        numbers.replace(path.with_suffix(".npz"))
        network.replace(path)


@contextmanager
def _temporary_folder_beside(path: Path) -> Iterator[Path]:
    """Make a temporary folder on the same disk, from which files can be renamed to `path`."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with TemporaryDirectory(dir=path.parent, prefix=".fit-") as folder_beside:
            yield Path(folder_beside)
    except OSError as error:
        raise TrainingError(
            f"{path} cannot be written ({(error.strerror or str(error)).lower()}): "
            "make room there or give another --out. Nothing was written"
        ) from error


def stored(path: Path) -> tuple[Network, Calibration]:
    """Open a network and calibration that `write` wrote. Raises PerceiverError, TrainingError."""
    network, calibration = opened(path), Calibration.load(path.with_suffix(".npz"))
    if calibration.classes != CLASSES:
        raise TrainingError(f"{path.name} knows other classes than a fit: give another network")
    return network, calibration


def opened(path: Path) -> Network:
    """Open a network as a function of a frame of any size. Raises PerceiverError."""
    run = open_network(path, Runtime(threads=1))
    return lambda image: run(network_input(image))
