"""Runs a module of this program without the current folder on Python's path: root may stand in anybody's."""

from __future__ import annotations

import os
import sys
from pathlib import Path

import companion

_ROOT = str(Path(companion.__file__).parents[1])
_RUN = """
import os, runpy, sys
path, module = sys.argv[1:3]
del sys.argv[1:3]
sys.path[:] = path.split(os.pathsep)
runpy.run_module(module, run_name="__main__", alter_sys=True)
"""


def isolated(module: str, *arguments: str) -> list[str]:
    """Return the command that runs `python -m module` so. Python 3.10 knows no -P for that, but -I."""
    return [sys.executable, "-I", "-c", _RUN, os.pathsep.join(_path()), module, *arguments]


def _path() -> list[str]:
    """Return this process's path, which PYTHONPATH may be part of: -I would leave that out."""
    try:
        here = os.path.realpath(os.getcwd())
    except OSError:  # it was deleted
        here = ""
    path = [one for one in sys.path if one == _ROOT or (os.path.isabs(one) and os.path.realpath(one) != here)]
    return path if _ROOT in path else [*path, _ROOT]
