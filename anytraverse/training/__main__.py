"""Trains the built-in network: python -m anytraverse.training FOLDER --out FILE.onnx [--made FOLDER] ..."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from anytraverse.errors import AnyTraverseError
from anytraverse.training.fit import fit, refuse_worse, scores, stored, write
from anytraverse.training.fitting import Options
from anytraverse.training.folders import Folder, Split, read_folder, suggested


def main() -> int:
    """Fit, tell the scores, and write the files unless they are worse than those they replace."""
    options = _parser().parse_args()
    try:
        real = read_folder(options.folder)
        made = Folder(tuple(f for folder in options.made for f in read_folder(folder).frames))
        split = (
            Split(tuple(options.validation), tuple(options.test)) if options.validation else suggested(real)
        )
        chosen = Options(seed=options.seed, steps=options.steps, threads=options.threads)
        fitted = fit(real, made, split, chosen, _tell)
        sys.stderr.write("\n")
        _report("validation", split.validation, fitted.validation.lines())
        if fitted.test:
            _report("test", split.test, fitted.test.lines())
        if options.out.exists():
            training, validation, _ = split.parts(real)
            refuse_worse(fitted, [scores(*stored(options.out), validation, training)])
        write(fitted, options.out)
    except AnyTraverseError as error:
        sys.stderr.write(f"\n{error}\n")
        return 1
    return 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(prog="python -m anytraverse.training", description=__doc__)
    parser.add_argument("folder", type=Path, help="NNNN.jpg, NNNN.png and classes.json")
    parser.add_argument("--out", type=Path, required=True, help="FILE.onnx; FILE.npz is written beside it")
    parser.add_argument(
        "--made", type=Path, action="append", default=[], help="a labelled folder of rendered frames"
    )
    parser.add_argument("--validation", type=int, nargs="+", help="blocks of a hundred numbers")
    parser.add_argument("--test", type=int, nargs="+", default=[], help="blocks that are only reported")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--steps", type=int, default=Options.steps)
    parser.add_argument("--threads", type=int, default=1)
    return parser


def _tell(done: int, steps: int, loss: float, left: float) -> None:
    sys.stderr.write(f"\r{done}/{steps} steps, loss {loss:.3f}, {left / 60:.1f} min left ")
    sys.stderr.flush()


def _report(what: str, blocks: tuple[int, ...], lines: list[str]) -> None:
    sys.stdout.write(f"{what}, blocks {', '.join(map(str, blocks))}\n")
    sys.stdout.writelines(f"  {line}\n" for line in lines)


if __name__ == "__main__":
    sys.exit(main())
