"""Runs the companion with a perceiver that can be broken: `python -m bench.stopping.perceivers run ...`.

`broken:FILE` is the built-in perceiver until FILE says otherwise.
"nan" or "one nan": maps that are NaN, everywhere or in one pixel.
"hang": once, a call that never returns.
"lock": once, the same in native code that holds the interpreter's lock.
"segfault": native code that reads an invalid address. "memory": killed as when memory runs out.
"no memory": no more memory is to be had from the kernel, and more is needed for every picture.
"slow SECONDS": each picture takes so much longer.
"same": every word is everywhere in every picture, at nearly no cost, where something else is measured.
"shape NAME": one of `SHAPES`. "shape embedding": an embedding that is one number too long.
`python -m bench.stopping.perceivers vision` is its vision process.
"""

from __future__ import annotations

import ctypes
import os
import resource
import signal
import sys
import threading
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from anytraverse.frame import Image
from anytraverse.perception import (
    KINDS,
    DefaultThresholds,
    Example,
    Features,
    Perceiver,
    Prompt,
    make_perceiver,
)
from anytraverse.perception.runtime import Runtime
from anytraverse.regions import Box

SHAPES: Mapping[str, Callable[[NDArray[np.float32]], Any]] = {
    "flat": lambda maps: maps[0],
    "one too few": lambda maps: maps[1:],
    "one too many": lambda maps: np.concatenate([maps, maps[:1]]),
    "empty": lambda maps: maps[:, :0],
    "bytes": lambda maps: np.round(255 * maps).astype(np.uint8),
    "objects": lambda maps: np.full(maps.shape, None),
    "nothing": lambda _: None,
}
"""What the perceiver makes of its maps, (n, h, w) float32, that no perceiver may deliver."""
_SPARE = 16 << 20
HANGS = 60.0
"""s for which the main loop of the supervisor hangs after SIGUSR1."""


def register() -> None:
    """Registers "broken" as a kind of perceiver in this process."""
    KINDS["broken"] = ("bench.stopping.perceivers", "Breakable")


class Breakable:
    """A `Perceiver` that works as long as its file is absent or empty."""

    def __init__(self, argument: str, runtime: Runtime) -> None:
        self._own: Perceiver = make_perceiver("builtin", runtime)
        self._file = Path(argument)
        self._first: Features | None = None

    @property
    def model_id(self) -> str:
        return self._own.model_id

    @property
    def vocabulary(self) -> tuple[str, ...] | None:
        return self._own.vocabulary

    @property
    def defaults(self) -> DefaultThresholds:
        return self._own.defaults

    def meaning(self, word: str) -> str:
        return self._own.meaning(word)

    def encode(self, image: Image) -> Features:
        fault = self._fault()
        if fault in ("hang", "lock"):  # once: the next process is well
            self._file.unlink(missing_ok=True)
        match fault:
            case "hang":
                threading.Event().wait()
            case "lock":
                ctypes.PyDLL(None).pause()  # PyDLL keeps the interpreter's lock
            case "segfault":
                ctypes.string_at(0)
            case "memory":
                os.kill(os.getpid(), signal.SIGKILL)
            case "no memory":
                pages = int(Path("/proc/self/statm").read_text(encoding="ascii").split()[0])
                limit = pages * resource.getpagesize() + _SPARE
                _limit_memory(limit)
                bytearray(4 * _SPARE)
            case slow if slow.startswith("slow "):
                time.sleep(float(slow.removeprefix("slow ")))
            case "":
                _limit_memory(resource.RLIM_INFINITY)
            case "same":
                self._first = self._first or self._own.encode(image)
                return self._first
        return self._own.encode(image)

    def attend(self, features: Features, prompts: Sequence[Prompt]) -> NDArray[np.float32]:
        maps = np.array(self._own.attend(features, prompts))
        fault = self._fault()
        if fault == "nan":
            maps[:] = np.nan
        elif fault == "one nan":
            maps[0, 0, 0] = np.nan
        elif fault == "same":
            maps[:] = 1.0
        shaped: NDArray[np.float32] = SHAPES.get(fault.removeprefix("shape "), np.asarray)(maps)
        return shaped

    def embed(self, features: Features) -> NDArray[np.float32]:
        own = self._own.embed(features)
        return np.append(own, own[:1]) if self._fault() == "shape embedding" else own

    def example(self, features: Features, box: Box) -> Example:
        return self._own.example(features, box)

    def _fault(self) -> str:
        try:
            return self._file.read_text(encoding="utf-8")
        except FileNotFoundError:
            return ""


def _limit_memory(size: int) -> None:
    """Limits the addresses of this process, in bytes."""
    resource.setrlimit(resource.RLIMIT_AS, (size, resource.getrlimit(resource.RLIMIT_AS)[1]))


if __name__ == "__main__":
    register()
    # Python runs a handler in the main thread, so that this hangs the main loop and nothing else.
    signal.signal(signal.SIGUSR1, lambda *_: time.sleep(HANGS))
    if sys.argv[1] == "vision":
        from companion.vision.process import main as see

        see(int(sys.argv[2]), int(sys.argv[3]))
    from companion.cli import main

    sys.exit(main(vision=(sys.executable, "-m", "bench.stopping.perceivers", "vision")))
