"""Runs a vision process that starts at once: `python -m bench.vision.synthetic DESCRIPTOR PARENT`."""

from __future__ import annotations

import sys

from anytraverse.perception import KINDS
from anytraverse.perception.runtime import Runtime
from bench.link.synthetic_frames import NumberPerceiver

COMMAND = (sys.executable, "-m", "bench.vision.synthetic")


def make(_: str, __: Runtime) -> NumberPerceiver:
    """Makes the perceiver of bench.link, which reads numbers off pictures."""
    return NumberPerceiver()


def register() -> None:
    """Registers "synthetic" as a kind of perceiver in this process."""
    KINDS["synthetic"] = ("bench.vision.synthetic", "make")


if __name__ == "__main__":
    from companion.vision.process import main

    register()
    main(int(sys.argv[1]), int(sys.argv[2]))
