"""Starts the vision process: `python -m companion.vision DESCRIPTOR PARENT`. Only the supervisor runs it."""

import sys

from companion.vision.process import main

if __name__ == "__main__":
    if len(sys.argv) != 3:
        sys.exit("companion.vision is started by `companion run`: type that")
    main(int(sys.argv[1]), int(sys.argv[2]))
