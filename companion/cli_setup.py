"""The command that sets up a rover in a browser."""

from __future__ import annotations

import argparse
import logging
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from anytraverse.release import to_install
from companion.cli_config import add_config
from companion.cli_errors import UserError, error_text
from companion.system.log_lines import log_to_stderr

if TYPE_CHECKING:
    Commands = argparse._SubParsersAction[argparse.ArgumentParser]

_BEGUN = "companion.toml"


def add_setup(commands: Commands, init: Callable[[str], int]) -> None:
    """Add setup. init: writes the files to begin with into a folder, and returns its exit code."""
    setup = commands.add_parser("setup", help="set up a rover in a browser, from nothing")
    add_config(setup, alone=True)
    setup.add_argument("--port", type=int, default=0, help="of the page; by default any free one")
    setup.set_defaults(run=partial(_setup, init))


def _setup(init: Callable[[str], int], options: argparse.Namespace) -> int:
    from companion.config import ConfigError

    log_to_stderr(logging.ERROR)
    path = Path(options.config)
    if not path.exists() and path.name == _BEGUN and (code := init(str(path.parent))):
        return code
    try:
        from companion.desk.setup.command import run

        return run(str(path), port=options.port)
    except ImportError as error:
        raise UserError(f"it needs {error.name}: {to_install('rover')}") from error
    except ConfigError as error:
        raise UserError(error_text(error)) from error
    except (OSError, OverflowError) as error:
        raise UserError(f"port {options.port}: {getattr(error, 'strerror', None) or error}") from error
