"""Starts what packs an incident: `python -m companion.recording.packing_process CHANNEL PARENT`."""

import sys

from companion.system.child_process import end_with, step_back

NICENESS = 19
FIRST_OUT = 1000
"""oom_score_adj: as the page has it, before the recorder."""

if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit("it is started by `companion run`: type `companion incident`")
    channel, parent = map(int, sys.argv[1:])
    end_with(parent)
    step_back(NICENESS, FIRST_OUT)

    from companion.recording.packing import main

    main(channel)
