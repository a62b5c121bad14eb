"""Names the commit that a benchmark measures."""

from __future__ import annotations

import subprocess
from pathlib import Path


def commit_of(root: Path) -> str:
    """Returns the short id of the checkout's commit, with "-dirty" for changed files; "" outside git."""
    asked = ["git", "describe", "--always", "--dirty", "--exclude=*"]
    try:
        return subprocess.run(asked, cwd=root, check=False, capture_output=True, text=True).stdout.strip()
    except OSError:  # git is not installed
        return ""
