"""Runs a module of this program without the current folder on Python's path: root may stand in anybody's."""

from __future__ import annotations

import sys
from pathlib import Path

import companion

_ROOT = str(Path(companion.__file__).parents[1])
_RUN = """
import runpy, sys
root, module = sys.argv[1:3]
del sys.argv[1:3]
root in sys.path or sys.path.insert(0, root)
runpy.run_module(module, run_name="__main__", alter_sys=True)
"""


def isolated(module: str, *arguments: str) -> list[str]:
    """Return the command that runs `python -m module` so. Python 3.10 knows no -P for that, but -I."""
    return [sys.executable, "-I", "-c", _RUN, _ROOT, module, *arguments]
