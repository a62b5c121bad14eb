"""Starts the live view: `python -m companion.live HOST PORT CHANNEL PARENT`. Only the supervisor runs it."""

import sys

from companion.system.child_process import end_with, step_back
from companion.system.socket_units import arguments

NICENESS = 15
FIRST_OUT = 1000
"""oom_score_adj: the live view goes with the page, before the recorder, which has 980."""

if __name__ == "__main__":
    given = arguments()
    if len(given) != 4:
        sys.exit("companion.live is started by `companion run`: type that")
    port, channel, parent = map(int, given[1:])
    end_with(parent)
    step_back(NICENESS, FIRST_OUT)

    from companion.live.process import main

    main(channel, given[0], port)
