"""Compiles the shims that stand between a program and its disk, and loads them into it."""

from __future__ import annotations

import os
import subprocess
from collections.abc import Mapping
from pathlib import Path


def compile_shim(source: Path, folder: Path) -> Path:
    """Compile a C file into a library in `folder` with `cc`. Raises RuntimeError if that fails."""
    library = folder / f"{source.stem}.so"
    command = ["cc", "-shared", "-fPIC", "-O1", "-o", str(library), str(source), "-ldl", "-lpthread"]
    try:
        done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    except (OSError, subprocess.TimeoutExpired) as error:
        raise RuntimeError(f"{source.name} needs a C compiler ({error}): install gcc, as cc") from error
    if done.returncode:
        raise RuntimeError(f"{source.name} does not compile: {done.stderr.strip()}")
    return library


def preloading(library: Path) -> Mapping[str, str]:
    """Return the variables that load the library into a program, before those that are loaded already."""
    return {"LD_PRELOAD": f"{library} {os.environ.get('LD_PRELOAD', '')}".strip()}
