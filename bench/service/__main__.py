"""Proves the installed service in a booted Debian: `sudo make service`, some ten minutes.

The first run makes a bare Debian with debootstrap and downloads the wheels, both into a cache outside of
the checkout. An emulated machine has the devices, which its kernel plays. All is deleted at the end. The
last line is one JSON object; the exit code is 0 if all passed.
"""

from __future__ import annotations

import argparse
import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from bench.commit import commit_of
from bench.service.apart import stand_in, vision
from bench.service.container import ROOT, Container, ContainerError, base, require, wheel, wheels
from bench.service.rover import FieldProcess
from bench.service.service import Figures, Service
from bench.service.steps import (
    crash_loop,
    hang,
    install,
    kill,
    oak,
    package,
    reboot,
    sigterm,
    uninstall,
    upgrade,
)
from bench.service.vm import devices

CACHE = Path(os.environ.get("XDG_CACHE_HOME", Path.home() / ".cache")) / "anytraverse-service"
STEPS = (
    "install",
    "sigterm",
    "reboot",
    "kill",
    "hang",
    "vision",
    "stand-in",
    "crash-loop",
    "upgrade",
    "oak",
    "uninstall",
    "package",
    "devices",
)


def main() -> int:
    """Run the steps. Returns the exit code."""
    parser = argparse.ArgumentParser(prog="python -m bench.service", description=__doc__)
    parser.add_argument("--cache", type=Path, default=CACHE, help="by default %(default)s")
    parser.add_argument(
        "--only", nargs="+", default=STEPS, choices=STEPS, metavar="STEP", help=", ".join(STEPS)
    )
    given = parser.parse_args()
    signal.signal(signal.SIGTERM, _end)
    commit = commit_of(ROOT)
    figures: Figures = {}
    failed = ""
    try:
        require()
        _prove(given.cache, given.only, figures)
    except (ContainerError, subprocess.TimeoutExpired) as error:
        failed = str(error)
        print(f"service: FAILED: {failed}", file=sys.stderr)
    print(json.dumps({"ok": not failed, "failed": failed.partition("\n")[0], "commit": commit, **figures}))
    return 1 if failed else 0


def _end(number: int, _frame: object) -> None:
    raise ContainerError(f"ended by signal {number}")


def _prove(cache: Path, only: Sequence[str], figures: Figures) -> None:
    print("service: make the bare system and the wheels, the first time", flush=True)
    root = base(cache)
    needed = wheels(cache, root)
    with tempfile.TemporaryDirectory(prefix="anytraverse-service-") as folder:
        checkout, own = _checkout(Path(folder)), wheel(Path(folder) / "own")
        shared = [(needed, "/wheels"), (own.parent, "/own"), (checkout, "/checkout")]
        with Container(root, read_only=shared) as container:
            figures["boot"] = {"running_s": round(container.boot(), 1)}
            service = Service(container, FieldProcess())
            try:
                _take_steps(service, own, only, figures)
            finally:
                service.field.close()
        if "devices" in only:
            figures["devices"] = found = devices(cache, needed, checkout)
            print(f"service: devices passed: {found}", flush=True)


def _take_steps(service: Service, own: Path, only: Sequence[str], figures: Figures) -> None:
    steps: tuple[Callable[[Service], Any], ...] = (
        install,
        sigterm,
        reboot,
        kill,
        hang,
        vision,
        stand_in,
        crash_loop,
        partial(upgrade, wheel=own),
        oak,
        uninstall,
        package,
    )
    for name, step in zip(STEPS[: len(steps)], steps, strict=True):
        if name in only:
            begun = time.monotonic()
            figures[name.replace("-", "_")] = found = step(service)
            print(f"service: {name} passed in {time.monotonic() - begun:.0f} s: {found}", flush=True)


def _checkout(folder: Path) -> Path:
    """A clean copy of what is committed or staged, as a user has it."""
    names = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, check=True, capture_output=True).stdout
    subprocess.run(
        ["tar", "-c", "--null", "-T", "-", "-f", str(folder / "checkout.tar")],
        cwd=ROOT,
        input=names,
        check=True,
    )
    checkout = folder / "checkout"
    checkout.mkdir()
    subprocess.run(["tar", "-x", "-f", str(folder / "checkout.tar"), "-C", str(checkout)], check=True)
    return checkout


if __name__ == "__main__":
    sys.exit(main())
