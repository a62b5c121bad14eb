"""Looks up which release is installed."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, version

DISTRIBUTION = "anytraverse-companion"


def own_version() -> str:
    """Return the version of the installed distribution; "0" where none is installed."""
    try:
        return version(DISTRIBUTION)
    except PackageNotFoundError:
        return "0"
