"""Exports the bundles that the benchmark runs. Run: python -m bench.clipseg.bundles MODELS [--tiny]"""

from __future__ import annotations

import argparse
import os
import shutil
from concurrent.futures import ProcessPoolExecutor
from multiprocessing import get_context
from pathlib import Path

from anytraverse.export import export_bundle
from anytraverse.export.dense_making import make_dense_bundle
from anytraverse.export.random_weights import DENSE, TINY_DENSE, random_dense
from bench.clipseg.checkpoints import quieten_transformers
from bench.clipseg.lineup import BUNDLES, Made, bundle_of

PRECISIONS = ("fp32", "int8")
MOST_WORKERS = 3
"""Bundles made at once: each takes 2 GB of memory meanwhile."""


def make(models: Path, name: str, tiny: bool = False) -> Path:
    """Makes one of `BUNDLES` anew: of the checkpoints that lie in `models`, or of random weights."""
    out, made = bundle_of(models, name), BUNDLES[name]
    shutil.rmtree(out, ignore_errors=True)
    size = made.tiny if tiny else made.size
    if made.model == "clipseg":
        _export_clipseg(models, out, made, size)
    else:
        architecture = (TINY_DENSE if tiny else DENSE)[made.model]
        checkpoint = random_dense(made.model, architecture, size)
        make_dense_bundle(out, checkpoint, size=size, precisions=PRECISIONS, name=name)
    return out


def _export_clipseg(models: Path, out: Path, made: Made, size: int) -> None:
    clip = str(models / "clip") if made.scene == "clip-b32" else None
    export_bundle(str(models / "clipseg"), out, size=size, precisions=PRECISIONS, scene=made.scene, clip=clip)


def main() -> None:
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition(".")[0])
    parser.add_argument("models", type=Path)
    parser.add_argument("--tiny", action="store_true")
    given = parser.parse_args()
    workers = min(len(os.sched_getaffinity(0)), MOST_WORKERS)
    with ProcessPoolExecutor(workers, get_context("spawn"), initializer=quieten_transformers) as pool:
        making = [pool.submit(make, given.models, name, given.tiny) for name in BUNDLES]
        for made in making:
            print(made.result(), flush=True)


if __name__ == "__main__":
    main()
