"""The command `companion memory`: what the rover has learnt."""

from __future__ import annotations

import argparse
import logging

from companion.cli_config import add_config
from companion.cli_errors import told
from companion.system.log_lines import log_to_stderr


def add_memory(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the command with its actions."""
    memory = commands.add_parser("memory", help="list, show, forget, export or import the answered scenes")
    shared = argparse.ArgumentParser(add_help=False)
    add_config(shared)
    actions = memory.add_subparsers(dest="action", required=True, metavar="action")
    each = actions.add_parser("list", help="one line for each scene, with its number")
    add_config(each, alone=True)
    each.add_argument("--json", action="store_true", help="the last line is one JSON object")
    show = actions.add_parser("show", parents=[shared], help="a scene's words, and where its picture is")
    show.add_argument("number", type=int, metavar="N", help="as listed")
    show.add_argument("--out", metavar="FILE", help="copy the picture to FILE")
    forget = actions.add_parser("forget", parents=[shared], help="forget scenes; the companion is stopped")
    forget.add_argument("which", nargs="+", metavar="N", help='as listed, or "all"')
    to = actions.add_parser("export", parents=[shared], help="write all scenes to a new file")
    to.add_argument("file", metavar="FILE")
    source = actions.add_parser(
        "import", parents=[shared], help="add an exported file's scenes; the companion is stopped"
    )
    source.add_argument("file", metavar="FILE")
    memory.set_defaults(run=_memory)


def _memory(options: argparse.Namespace) -> int:
    log_to_stderr(logging.ERROR)
    from companion.desk.memory import command
    from companion.storage import JournalError

    with told(JournalError, command.MemoryCommandError):
        match options.action:
            case "list":
                return command.show_list(options.config, as_json=options.json)
            case "show":
                return command.show_scene(options.config, options.number, options.out)
            case "forget":
                return command.forget(options.config, options.which)
            case "export":
                return command.export(options.config, options.file)
            case _:
                return command.take_in(options.config, options.file)
