"""Writes stamped grey pictures to standard output: `raw_writer.py WIDTH HEIGHT RATE [FRAMES]`."""

from __future__ import annotations

import os
import sys
import time

from bench.cameras.stamps import stamped


def main(width: str, height: str, rate: str, frames: str = "0") -> None:
    """Write pictures until the reader is gone, or FRAMES of them."""
    due, written = time.monotonic(), 0
    while frames == "0" or written < int(frames):
        time.sleep(max(0.0, due - time.monotonic()))
        due = max(due + 1.0 / float(rate), time.monotonic())
        picture = memoryview(stamped(int(width), int(height), time.monotonic()))
        while picture:
            picture = picture[os.write(1, picture) :]
        written += 1
    print("no more pictures at 0x55d0c0ffee", file=sys.stderr)
    sys.exit(3)


if __name__ == "__main__":
    main(*sys.argv[1:])
