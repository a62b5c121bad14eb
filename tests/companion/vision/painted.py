"""A vision process that sees what the test paints; `COMMAND` starts it.

`painted` is `Painted`; `painted:0.1` takes so many seconds a frame; `painted:broken` cannot be loaded,
`painted:slow` takes a minute to load. `painted:FILE` does what the file says, as soon as it says so: "die"
(SIGSEGV), "hang", "lock" (hang in native code that keeps the interpreter's lock), "exit" (ends with code 3),
"slow" (0.15 s for each frame).
"""

from __future__ import annotations

import ctypes
import os
import signal
import sys
import threading
import time
from pathlib import Path

from anytraverse.errors import PerceiverError
from anytraverse.frame import Image
from anytraverse.perception import KINDS
from anytraverse.perception.runtime import Runtime
from tests.anytraverse.conftest import Painted

COMMAND = (sys.executable, "-m", "tests.companion.vision.painted")


class Obedient(Painted):
    """Painted eyes that break when told to."""

    def __init__(self, argument: str, _: Runtime) -> None:
        super().__init__()
        if argument == "broken":
            raise PerceiverError("painted eyes cannot be loaded: paint them again")
        if argument == "slow":
            time.sleep(60.0)
        self._seconds = float(argument) if argument.replace(".", "").isdecimal() else 0.0
        self._file = Path(argument) if "/" in argument else None

    def encode(self, image: Image) -> Image:
        """The picture itself, unless something else is wanted."""
        time.sleep(self._seconds)
        self._obey()
        return super().encode(image)

    def _obey(self) -> None:
        order = self._file.read_text() if self._file is not None and self._file.is_file() else ""
        if order == "die":
            os.kill(os.getpid(), signal.SIGSEGV)
        elif order == "hang":
            threading.Event().wait()
        elif order == "lock":
            ctypes.PyDLL(None).pause()  # a PyDLL keeps the interpreter's lock
        elif order == "exit":
            os._exit(3)
        elif order == "slow":
            time.sleep(0.15)


def register() -> None:
    """Make "painted" a kind of perceiver in this process."""
    KINDS["painted"] = ("tests.companion.vision.painted", "Obedient")


if __name__ == "__main__":
    from companion.vision.process import main

    register()
    main(int(sys.argv[1]), int(sys.argv[2]))
