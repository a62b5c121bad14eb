"""Starts the page: `python -m companion.web CHANNEL LISTENER PARENT`. Only the supervisor runs it."""

import sys

from companion.web.server import main

if __name__ == "__main__":
    if len(sys.argv) != 4:
        sys.exit("companion.web is started by `companion run`: type that")
    main(*map(int, sys.argv[1:]))
