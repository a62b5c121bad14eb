"""Starts the vision process: `python -m companion.vision CHANNEL PARENT`. Only the supervisor runs it."""

import os
import sys

from companion.system.socket_units import arguments

if __name__ == "__main__":
    given = arguments()
    if len(given) != 2:
        sys.exit("companion.vision is started by `companion run`: type that")
    # NumPy's threads would wait busily beside the network's: they double a frame's CPU time and save nothing.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

    from companion.vision.process import main

    main(*map(int, given))
