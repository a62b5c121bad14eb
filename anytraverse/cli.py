"""`anytraverse`: the algorithm without a rover."""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence

from anytraverse.errors import AnyTraverseError


def main(arguments: Sequence[str] | None = None) -> int:
    """Run a command; 0 when it did its work, 2 with one line on stderr when the input cannot be used."""
    parser = argparse.ArgumentParser(prog="anytraverse", description=__doc__)
    commands = parser.add_subparsers(dest="command", required=True, metavar="command")
    _add_look(commands.add_parser("look", help="judge one picture, and draw what was found"))
    options = parser.parse_args(arguments)
    try:
        code: int = options.run(options)
    except (AnyTraverseError, OSError) as error:
        print(f"anytraverse {options.command}: {_one_line(error)}", file=sys.stderr)
        return 2
    return code


def _add_look(parser: argparse.ArgumentParser) -> None:
    from anytraverse.look import DEFAULT_PROMPTS, run

    parser.description = "Judge one picture: what is drivable, what is unknown."
    parser.add_argument("image", metavar="IMAGE", help="a picture file, e.g. JPEG or PNG")
    parser.add_argument(
        "--prompts",
        default=DEFAULT_PROMPTS,
        metavar="WORDS",
        help='words and weights from -1 (never drive) to 1 (drive), by default "%(default)s"',
    )
    parser.add_argument("--perceiver", default="builtin", help="which eyes, by default %(default)s")
    parser.add_argument("--out", metavar="PNG", help="write the panel of all maps to this file")
    parser.add_argument("--json", action="store_true", help="print the figures as JSON on the last line")
    parser.set_defaults(run=run)


def _one_line(error: Exception) -> str:
    if isinstance(error, OSError) and error.filename is not None:
        return f"{error.filename}: {(error.strerror or str(error)).lower()}"
    return " ".join(str(error).split())


if __name__ == "__main__":
    sys.exit(main())
