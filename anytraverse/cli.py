"""Runs the algorithm without a rover: the command `anytraverse`."""

from __future__ import annotations

import argparse
import importlib
import sys
from collections.abc import Mapping, Sequence
from typing import Union

from anytraverse.errors import AnyTraverseError, file_error
from anytraverse.release import needed, own_version

Commands = Mapping[str, tuple[str, Union[str, "Commands"]]]

COMMANDS: Commands = {
    "look": ("judge one picture, and draw what was found", "anytraverse.look"),
    "score": (
        "score drivable ground and words on labelled frames, at a glance",
        "anytraverse.evaluation.score_command",
    ),
    "evaluate": (
        "score a perceiver on a published data set, beside the paper's figures",
        "anytraverse.evaluation.evaluate_command",
    ),
    "sweep": (
        "compare sets of words on a data set",
        "anytraverse.evaluation.sweep_command",
    ),
    "calls": (
        "count the calls that a drive raises, by many thresholds",
        "companion.desk.tuning.calls_command",  # the rules of calls are the companion's
    ),
    "roi-exchange": (
        "exchange the regions of interest of several vehicles, on a simulated trail",
        "companion.desk.exchange.command",
    ),
    "fit": ("fit the built-in network to labelled frames of your own", "anytraverse.training.command"),
    "export": ("make a bundle of a CLIPSeg checkpoint, for a rover to run", "anytraverse.export.command"),
    "bundle": (
        "check a bundle, or make one of your own network",
        {
            "check": ("verify a bundle and time it on this machine", "anytraverse.bundle.check_command"),
            "classes": ("make a bundle of a segmentation network", "anytraverse.bundle.from_network"),
        },
    ),
}
"""Command -> its help text, and its module (with `add_arguments` and `run`) or its subcommands.

A module is imported only when its command is chosen.
"""

EXTRAS = {"export": "export", "fit": "train"}
"""Command -> the pip extra that installs its dependencies; all other commands need `rover`."""


LONG = frozenset({"evaluate", "sweep", "calls", "roi-exchange"})
"""Commands that take minutes. They say that they begin before anything is imported for them."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command and return its exit code; 2, with one line on stderr, when the input cannot be used."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    _begin(words)
    try:
        options = parser(words).parse_args(words)
        code: int = options.run(options)
    except ModuleNotFoundError as error:
        print(f"{_command(words)}: {needed(error, EXTRAS.get(words[0], 'rover'))}", file=sys.stderr)
        return 2
    except (AnyTraverseError, OSError) as error:
        print(f"{_command(words)}: {_one_line(error)}", file=sys.stderr)
        return 2
    except KeyboardInterrupt:
        return 130
    return code


def parser(words: Sequence[str] | None = None) -> argparse.ArgumentParser:
    """Return the parser, with the arguments of the command that `words` begin with; None: of all commands."""
    root = argparse.ArgumentParser(prog="anytraverse", description=__doc__)
    root.add_argument("--version", action="version", version=f"%(prog)s {own_version()}")
    _add(root, COMMANDS, words)
    return root


def _add(parser: argparse.ArgumentParser, commands: Commands, words: Sequence[str] | None) -> None:
    actions = parser.add_subparsers(required=True, metavar="command")
    for name, (text, below) in commands.items():
        action = actions.add_parser(name, help=text)
        if words is not None and words[:1] != [name]:
            continue
        if isinstance(below, str):
            module = importlib.import_module(below)
            module.add_arguments(action)
            action.set_defaults(run=module.run)
        else:
            _add(action, below, None if words is None else words[1:])


def _begin(words: Sequence[str]) -> None:
    """Say that a long command begins: its imports alone take seconds on a busy or a small computer."""
    if LONG.intersection(words[:1]) and not {"-h", "--help"}.intersection(words):
        print(f"{_command(words)}: starting", file=sys.stderr, flush=True)


def _command(words: Sequence[str]) -> str:
    """Return the chosen command with its subcommands, e.g. "anytraverse bundle check"."""
    name, below = "anytraverse", COMMANDS
    for word in words:
        if word not in below:
            break
        name, following = f"{name} {word}", below[word][1]
        if isinstance(following, str):
            break
        below = following
    return name


def _one_line(error: Exception) -> str:
    if isinstance(error, OSError) and error.filename is not None:
        return file_error(error)
    return " ".join(str(error).split())


if __name__ == "__main__":
    sys.exit(main())
