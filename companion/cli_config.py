"""Which configuration a command is about: the same option for all of them."""

from __future__ import annotations

import argparse
import os

SERVICE = "/etc/anytraverse/companion.toml"
"""The installed service's configuration."""

_HELP = f"the configuration; by default ./companion.toml, or {SERVICE} where there is none here"


def add_config(parser: argparse.ArgumentParser, *, alone: bool = False) -> None:
    """Add `--config FILE`, and where nothing else is named, FILE `alone`.

    `options.config` is None where neither is given: then it is `default_config`.
    """
    if not alone:
        parser.add_argument("--config", metavar="FILE", help=_HELP)
        return
    either = parser.add_mutually_exclusive_group()
    # Left out, it is suppressed: its default would overwrite what --config has set.
    either.add_argument("config", nargs="?", default=argparse.SUPPRESS, metavar="FILE", help=_HELP)
    either.add_argument("--config", metavar="FILE", help="the same")


def default_config() -> str:
    """Return the configuration of this folder, or the service's where there is none here."""
    return SERVICE if not os.path.exists("companion.toml") and os.path.exists(SERVICE) else "companion.toml"
