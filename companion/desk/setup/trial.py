"""Has the companion that runs raise its test call, by `companion check --dry-run`."""

from __future__ import annotations

import subprocess
from pathlib import Path

from companion.daemon.trial_call import ANSWERED_WITHIN
from companion.desk.check.running import TAKEN_WITHIN
from companion.pages.requests import RequestError
from companion.system.isolated import isolated

LIMIT = ANSWERED_WITHIN + 3 * TAKEN_WITHIN + 10.0
"""Seconds. The command ends by itself before."""


def raise_test_call(file: Path) -> dict[str, object]:
    """Run the command. Returns whether the call was answered, and what it said. Raises RequestError."""
    command = isolated("companion", "check", "--dry-run", str(file))
    try:
        ran = subprocess.run(command, capture_output=True, text=True, timeout=LIMIT, check=False)
    except subprocess.TimeoutExpired as error:
        raise RequestError(
            f"the test call did not end within {LIMIT:.0f} s: see the companion's log"
        ) from error
    except OSError as error:
        raise RequestError(f"companion check cannot be started: {(error.strerror or '').lower()}") from error
    said = (ran.stdout + ran.stderr).strip().splitlines()
    return {"answered": ran.returncode == 0, "said": said[-4:]}
