"""Starts the recorder: `python -m companion.recording FOLDER BYTES CHANNEL PARENT`: by the supervisor."""

import sys

from companion.system.child_process import end_with, step_back
from companion.system.socket_units import arguments

NICENESS = 15
FIRST_OUT = 980
"""oom_score_adj: the recorder goes after the page, which has 1000, and before the video and vision."""

if __name__ == "__main__":
    given = arguments()
    if len(given) != 4:
        sys.exit("companion.recording is started by `companion run`: type that")
    channel, parent = map(int, given[2:])
    end_with(parent)
    step_back(NICENESS, FIRST_OUT)

    from companion.recording.process import main

    main(channel, given[0], int(given[1]))
