"""Looks up which program is installed."""

from __future__ import annotations

import os
import shlex
import sys
from functools import lru_cache
from pathlib import Path

DISTRIBUTION = "anytraverse-companion"
_LIBRARIES = (
    *("numpy", "onnxruntime", "onnxruntime-gpu", "onnxruntime-openvino"),
    *("opencv-python", "opencv-python-headless"),
)
"""Whose arithmetic decides what a perceiver makes of a picture, by each name that they come under."""


def own_version() -> str:
    """Return the version of the installed distribution; "0" where none is installed."""
    return _version(DISTRIBUTION)


def to_install(extra: str) -> str:
    """Return what to type for an extra: by the Python that runs, with sudo where it is not the user's."""
    sudo = "" if os.access(sys.prefix, os.W_OK) and "SUDO_USER" not in os.environ else "sudo "
    return f'{sudo}{shlex.quote(sys.executable)} -m pip install "{DISTRIBUTION}[{extra}]"'


def needed(error: ModuleNotFoundError, extra: str) -> str:
    """Return which package a command lacks, and what to type. Raises the error for a module of ours."""
    missing = (error.name or "").partition(".")[0]
    if missing in ("", "anytraverse", "companion", "gcs_plugin"):
        raise error
    return f"needs {missing}: {to_install(extra)}"


@lru_cache(1)
def program_identity() -> str:
    """Return a digest of all that decides what is made of a picture: this package's code, and libraries.

    Nothing that was stored under another one may be taken for what this program would make.
    """
    import hashlib

    digest = hashlib.sha256(" ".join(map(_version, _LIBRARIES)).encode())
    root = Path(__file__).parent
    for path in sorted(root.rglob("*.py")):
        digest.update(f"\n{path.relative_to(root)}\n".encode() + path.read_bytes())
    return digest.hexdigest()[:12]


def _version(distribution: str) -> str:
    # Here, since it takes half of the time in which `companion` starts.
    from importlib.metadata import PackageNotFoundError, version

    try:
        return version(distribution)
    except PackageNotFoundError:
        return "0"
