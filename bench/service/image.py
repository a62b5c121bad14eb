"""Proves the image of `make image` by podman, as docs/install.md runs it: `sudo make image-check`.

All is deleted at the end. The last line is one JSON object; the exit code is 0 if all passed.
"""

from __future__ import annotations

import argparse
import json
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from bench.commit import commit_of
from bench.service.apart import vision
from bench.service.container import ROOT, ContainerError
from bench.service.image_steps import camera, crash_loop, kept, serial, start, unwritable
from bench.service.podman import ContainedService, PodmanContainer, podman, require
from bench.service.rover import FieldProcess
from bench.service.service import Figures
from bench.service.steps import hang, kill, reboot, sigterm

STEPS: dict[str, Callable[[ContainedService], Any]] = {
    "start": start,
    "sigterm": sigterm,
    "reboot": reboot,
    "kill": kill,
    "hang": hang,
    "vision": vision,
    "crash-loop": crash_loop,
    "serial": serial,
    "camera": camera,
    "kept": kept,
    "unwritable": unwritable,
}


def main() -> int:
    """Load the image and run the steps. Returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m bench.service.image", description=__doc__)
    parser.add_argument("--image", type=Path, help="by default the newest in dist/")
    parser.add_argument(
        "--only", nargs="+", default=[*STEPS], choices=STEPS, metavar="STEP", help=", ".join(STEPS)
    )
    given = parser.parse_args()
    signal.signal(signal.SIGTERM, _end)
    figures: Figures = {}
    failed = ""
    try:
        require()
        _prove(given.image or _newest(), given.only, figures)
    except (ContainerError, subprocess.TimeoutExpired) as error:
        failed = str(error)
        print(f"image: FAILED: {failed}", file=sys.stderr)
    said = {"ok": not failed, "failed": failed.partition("\n")[0], "commit": commit_of(ROOT), **figures}
    print(json.dumps(said))
    return 1 if failed else 0


def _end(number: int, _frame: object) -> None:
    raise ContainerError(f"ended by signal {number}")


def _newest() -> Path:
    found = sorted(ROOT.glob("dist/*.oci.tar"), key=lambda path: path.stat().st_mtime)
    if not found:
        raise ContainerError("dist/ has no image: type: sudo make image")
    return found[-1]


def _prove(file: Path, only: Sequence[str], figures: Figures) -> None:
    begun = time.monotonic()
    image = podman("load", "--quiet", "--input", str(file)).rpartition(" ")[2]
    try:
        unpacked = int(podman("image", "inspect", "--format={{.Size}}", image))
        figures["image"] = {
            "file_mb": file.stat().st_size >> 20,
            "unpacked_mb": unpacked >> 20,
            "load_s": round(time.monotonic() - begun, 1),
        }
        with PodmanContainer(image) as container:
            service = ContainedService(container, FieldProcess())
            try:
                _take_steps(service, only, figures)
            finally:
                service.field.close()
    finally:
        podman("image", "rm", "--force", image)


def _take_steps(service: ContainedService, only: Sequence[str], figures: Figures) -> None:
    if "start" not in only:
        start(service)
    for name, step in STEPS.items():
        if name in only:
            begun = time.monotonic()
            figures[name.replace("-", "_")] = found = step(service)
            print(f"image: {name} passed in {time.monotonic() - begun:.0f} s: {found}", flush=True)


if __name__ == "__main__":
    sys.exit(main())
