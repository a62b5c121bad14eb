"""Which release this is."""

from __future__ import annotations

from importlib.metadata import PackageNotFoundError, version

DISTRIBUTION = "anytraverse-companion"


def own_version() -> str:
    """Of the installed distribution, "0" where there is none."""
    try:
        return version(DISTRIBUTION)
    except PackageNotFoundError:
        return "0"
