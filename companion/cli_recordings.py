"""The commands for what a rover has recorded: list, repair, pack, and give evidence of it."""

from __future__ import annotations

import argparse
import logging
from collections.abc import Callable
from typing import TYPE_CHECKING

from companion.cli_config import add_config
from companion.cli_errors import UserError, told
from companion.system.log_lines import log_to_stderr

if TYPE_CHECKING:
    Commands = argparse._SubParsersAction[argparse.ArgumentParser]


def add_recordings(commands: Commands) -> None:
    """Add record, incident and evidence."""
    shared = argparse.ArgumentParser(add_help=False)
    add_config(shared)
    record = commands.add_parser("record", help="list or repair what was recorded")
    actions = record.add_subparsers(dest="action", required=True, metavar="action")
    each = actions.add_parser("list", help="one line for each recording")
    add_config(each, alone=True)
    each.add_argument("--json", action="store_true", help="the last line is one JSON object")
    torn = actions.add_parser("repair", help="give a recording that was cut off its index again")
    torn.add_argument("file", metavar="FILE", help="it is replaced once the new one is complete")
    record.set_defaults(run=_record)
    incident = commands.add_parser(
        "incident", parents=[shared], help="put all about a call into one file to send to somebody"
    )
    incident.add_argument("call", nargs="?", metavar="CALL", help="C7, or H7 for a hold")
    incident.add_argument("--last", metavar="TIME", help="the last 60s, 5m or 1h instead")
    incident.add_argument("--out", metavar="FILE", help="by default incident-C7.zip here")
    incident.set_defaults(run=_incident)
    proof = commands.add_parser("evidence", help="put what this rover has shown into one signed file")
    add_config(proof, alone=True)
    proof.add_argument("--out", metavar="ZIP", help="by default evidence-TIME.zip here")
    proof.add_argument("--no-check", action="store_true", help="leave out what `companion check` says now")
    proof.add_argument("--verify", metavar="ZIP", help="write nothing: check such a file, and name its key")
    proof.set_defaults(run=_evidence)


def _record(options: argparse.Namespace) -> int:
    from companion.observers.recording import command

    if options.action == "list":
        return _of_recordings(lambda: command.show_list(options.config, as_json=options.json))
    return _of_recordings(lambda: command.repair(options.file))


def _incident(options: argparse.Namespace) -> int:
    from companion.observers.recording import command

    return _of_recordings(lambda: command.pack(options.config, options.call, options.last, options.out))


def _evidence(options: argparse.Namespace) -> int:
    log_to_stderr(logging.ERROR)
    from companion.desk.evidence import command

    if options.verify is not None:
        return _of_recordings(lambda: command.check(options.verify))
    return _of_recordings(lambda: command.write(options.config, options.out, checks=not options.no_check))


def _of_recordings(act: Callable[[], int]) -> int:
    from companion.desk.evidence.signature import EvidenceError
    from companion.observers.recording.command import RecordError

    try:
        with told(EvidenceError, RecordError):
            return act()
    except OSError as error:
        why = (error.strerror or str(error)).lower()
        more = ": you may have to type this with sudo" if isinstance(error, PermissionError) else ""
        raise UserError(f"{error.filename or 'the disk'}: {why}{more}") from error
