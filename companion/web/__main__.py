"""Starts the page: `python -m companion.web CHANNEL LISTENER PARENT`. Only the supervisor runs it."""

import sys

from companion.system.child_process import end_with, step_back
from companion.system.socket_units import arguments

NICENESS = 10
FIRST_OUT = 1000
"""oom_score_adj: the page goes before the vision process, which has 900."""

if __name__ == "__main__":
    given = arguments()
    if len(given) != 3:
        sys.exit("companion.web is started by `companion run`: type that")
    channel, listener, parent = map(int, given)
    end_with(parent)
    step_back(NICENESS, FIRST_OUT)  # before the imports: they keep a small computer busy for a second

    from companion.web.server import main

    main(channel, listener)
