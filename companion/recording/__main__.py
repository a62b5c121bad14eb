"""Starts the recorder: `python -m companion.recording FOLDER BYTES CHANNEL PARENT`: by the supervisor."""

import sys

from companion.system.child_process import end_with, step_back

NICENESS = 15
FIRST_OUT = 980
"""oom_score_adj: the recorder goes after the page, which has 1000, and before the video and vision."""

if __name__ == "__main__":
    if len(sys.argv) != 5:
        sys.exit("companion.recording is started by `companion run`: type that")
    channel, parent = map(int, sys.argv[3:])
    end_with(parent)
    step_back(NICENESS, FIRST_OUT)

    from companion.recording.process import main

    main(channel, sys.argv[1], int(sys.argv[2]))
