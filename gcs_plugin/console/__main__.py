"""Starts the console: `python -m gcs_plugin.console`."""

import sys

from gcs_plugin.console.main import main

if __name__ == "__main__":
    sys.exit(main())
