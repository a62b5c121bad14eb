"""Runs the operator's terminal: `python -m gcs_plugin.terminal`."""

import sys

from gcs_plugin.terminal.main import main

if __name__ == "__main__":
    sys.exit(main())
