"""Does the work of `anytraverse fit`: reads, splits, trains, compares, and writes or refuses."""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import dataclass, replace
from pathlib import Path
from shlex import quote
from tempfile import TemporaryDirectory

import numpy as np

from anytraverse.errors import AnyTraverseError, TrainingError
from anytraverse.evaluation.progress import Progress
from anytraverse.perception.builtin.perceiver import SHIPPED
from anytraverse.training.calibration import FEWEST_FRAMES
from anytraverse.training.classes import DRIVABLE
from anytraverse.training.cutouts import Cutout, read_cutouts, split_cutouts
from anytraverse.training.fit import Fitted, check_out, details, fit, fit_on, stored, write
from anytraverse.training.fitting import REFIT, FitOptions, Material
from anytraverse.training.folders import Folder, Split, read_folder, suggested
from anytraverse.training.held_out import HeldOutComparison, Model, compare


@dataclass(frozen=True, eq=False)
class _Work:
    """Holds the input of a fit.

    start: the network to train on from, or None. replaced: the file of the network that the fit must not be
    worse than, and that network.
    """

    material: Material
    split: Split
    options: FitOptions
    start: Path | None
    replaced: tuple[Path, Model]


def run_fit(given: argparse.Namespace) -> int:
    """Fit, compare and write. Returns the exit code: 1 when nothing was written.

    Raises AnyTraverseError, OSError.
    """
    try:
        work = prepared(given)
        with TemporaryDirectory() as folder:
            fitted = trained(work, Path(folder))
            _say("scoring on the drives that were held out")
            return _compare_and_write(given, work, fitted)
    except KeyboardInterrupt:
        _say("stopped: nothing was written")
        raise


def prepared(given: argparse.Namespace) -> _Work:
    """Check and read all input, so that errors come before the training. Raises AnyTraverseError, OSError."""
    check_out(given.out)
    start = None if given.start == "scratch" else SHIPPED if given.start == "builtin" else Path(given.start)
    replaced = given.out if given.out.exists() else SHIPPED
    try:
        model = stored(replaced)
    except AnyTraverseError as error:
        raise TrainingError(
            f"{replaced} is there, and no fit can be compared with it ({error}): "
            "remove it or give another --out"
        ) from error
    if start is not None:
        stored(start)
    options = REFIT if start else FitOptions()
    steps = options.steps if given.steps is None else given.steps
    if given.threads < 1 or steps < (0 if start else 1):
        raise TrainingError("--threads and --steps begin at 1; --steps 0 needs a network to begin from")
    options = replace(options, steps=steps, seed=given.seed, threads=given.threads)
    real = read_folder(given.folder, torn=_report_torn)
    if strange := {*(given.validation or ()), *given.test} - set(real.blocks):
        raise TrainingError(
            f"{given.folder} has no drive {min(strange)}: its blocks of a hundred numbers are "
            f"{', '.join(map(str, real.blocks))}"
        )
    made = Folder(tuple(f for path in given.made for f in read_folder(path, torn=_report_torn).frames))
    test = tuple(given.test)
    split = Split(tuple(given.validation), test) if given.validation else suggested(real, test)
    training, validation, _ = split.parts(real)
    for name, part in (("to train on", training), ("held out", validation)):
        if not any(np.isin(frame.labels, DRIVABLE).any() for frame in part.frames):
            raise TrainingError(
                f"nothing on the drives {name} is labelled drivable: label the ground that may be driven as "
                "trail, rough trail or grass"
            )
    if len(validation) < FEWEST_FRAMES:
        raise TrainingError(
            f"the drives held out have {len(validation)} frames, and at least {FEWEST_FRAMES} must choose "
            "the calibration: label more frames on them, or hold out more drives with --validation"
        )
    cutouts = read_cutouts(given.cutouts) if given.cutouts else ()
    kept: tuple[Cutout, ...] = ()
    if cutouts and start:  # from scratch all are needed: made things alone check that training
        cutouts, kept = split_cutouts(cutouts)
    return _Work(Material(real, made, cutouts, kept), split, options, start, (replaced, model))


def trained(work: _Work, folder: Path) -> Fitted:
    """Train with a progress bar; the network is written to `folder`. Raises TrainingError."""
    shown = 0

    def report_progress(done: int, _steps: int, loss: float, _left: float) -> None:
        nonlocal shown
        bar.step(done - shown, f", loss {loss:.3f}")
        shown = done

    with Progress(work.options.steps, "steps") as bar:
        if work.start is None:
            return fit(work.material, work.split, work.options, folder, report_progress)
        return fit_on(work.start, work.material, work.split, work.options, folder, report_progress)


def _compare_and_write(given: argparse.Namespace, work: _Work, fitted: Fitted) -> int:
    training, validation, test = work.split.parts(work.material.real)
    (replaced, before), model = work.replaced, fitted.model
    cutouts = work.material.kept_cutouts
    compared = compare(model, before, validation, cutouts, chosen_here=True)
    tested = compare(model, before, test, cutouts, chosen_here=False) if len(test) else None
    refusal = compared.refusal()
    unchanged = refusal is None and _unchanged(work, fitted)
    figures = {
        "written": refusal is None and not unchanged,
        **compared.figures(),
        "test": tested.figures() if tested else None,
        "trained_on": len(training),
        "folder": str(given.folder),
        "from": given.start,
        "steps": work.options.steps,
        "seed": work.options.seed,
        "out": str(given.out),
        "replaces": "builtin" if replaced == SHIPPED else str(replaced),
    }
    if not given.json:
        print(f"{given.folder}: {len(training)} frames trained on; {figures['replaces']} is what it replaces")
        _show("drives that chose its calibration", compared, details(model, validation, training))
        if tested:
            _show("test drives, only reported", tested, details(model, test, training))
    if refusal is None and not unchanged:
        write(fitted, given.out)
        if not given.json:
            print(_next(given.out))
    elif refusal is None:
        _say(
            "anytraverse fit: no other calibration is better on the drives held out without losing things. "
            f"Nothing was written. {_advice(work, compared)}"
        )
    else:
        _say(
            f"anytraverse fit: refused, worse than what it would replace: {refusal} on the drives held out. "
            f"Nothing was written. {_advice(work, compared)}"
        )
    print(json.dumps(figures, allow_nan=False))
    return 0 if figures["written"] else 1


def _unchanged(work: _Work, fitted: Fitted) -> bool:
    """Return whether the fit is the network that it began from."""
    if work.start is None or work.options.steps:
        return False
    before, now = stored(work.start)[1], fitted.calibration
    return np.array_equal(before.bias, now.bias) and np.array_equal(before.limits, now.limits)


def _advice(work: _Work, compared: HeldOutComparison) -> str:
    if not work.options.steps:
        return "Label more drives, or keep the network as it is"
    advice = "Label more drives, or try another --seed"
    if work.start and compared.calibrating_helps:
        advice += ", or fit the calibration only: --steps 0"
    return advice


def _show(what: str, compared: HeldOutComparison, more: list[str]) -> None:
    print("\n".join([f"  {what}", *compared.table(), *(f"    {line}" for line in more)]))


def _next(out: Path) -> str:
    name = f"builtin:{out.resolve()}"
    return (
        f"{out} and {out.with_suffix('.npz').name} are written; keep them together\n"
        f"  try   anytraverse look PICTURE --perceiver {quote(name)} "
        '--prompts "trail: 1; grass: 1; bush: -1" --out panel.png\n'
        f'  use   name = "{name}" under [perceiver] in companion.toml'
    )


def _report_torn(what: str) -> None:
    _say(f"{what}, skipped")


def _say(line: str) -> None:
    print(line, file=sys.stderr, flush=True)
