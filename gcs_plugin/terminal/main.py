"""The terminal operator: shows what rovers ask for, and takes answers from the keyboard or from a table."""

from __future__ import annotations

import argparse
import os
import signal
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import TextIO

from anytraverse.release import own_version
from companion.wire.signing_store import SigningKeyError, read_key
from gcs_plugin.client.client import OperatorClient
from gcs_plugin.terminal import wording
from gcs_plugin.terminal.connection import EXAMPLES, LinkError, OperatorConnection, open_connection
from gcs_plugin.terminal.output import JsonOutput, LoggedOutput, Output, TextOutput
from gcs_plugin.terminal.pictures import Pictures
from gcs_plugin.terminal.runner import Keyboard, Runner
from gcs_plugin.terminal.script import Script, ScriptError
from gcs_plugin.terminal.session import Session
from gcs_plugin.terminal.signing import OperatorSigning, open_signing

CYCLE_S = 0.05
SILENT_S = 10.0
NOBODY = "no rover is heard yet: is the link right, and does the companion run?"
UNSIGNED = "rover {} believes only what is signed: start again with --signing-key FILE"
MAX_SCRIPT_BYTES = 1 << 20


def main(argv: Sequence[str] | None = None) -> int:
    """Run until `quit`, the end of the input, --quit-after or a signal. Returns the exit code."""
    options = parser().parse_args(argv)
    stopped = _Stopped()
    try:
        script = None if options.script is None else _read_script(options.script)
        log = None if options.log is None else open_log(options.log)
        key = None if options.signing_key is None else read_key(options.signing_key)
        connection = open_connection(options.connect)
    except (LinkError, ScriptError, SigningKeyError, _LogError) as error:
        print(f"anytraverse-operator: {error}", file=sys.stderr)
        return 2
    client = OperatorClient()
    signing = None if key is None else open_signing(key, options.system, options.component)
    runner = Runner(connection, client, options.system, options.component, signing)
    started = time.monotonic()
    output: Output = (
        JsonOutput(sys.stdout, started)
        if options.events
        else TextOutput(sys.stdout, colours=_colours(sys.stdout))
    )
    if log is not None:
        output = LoggedOutput(output, JsonOutput(log, started))
    pictures = Pictures(options.pictures, show=options.show)
    session = Session(client, output, script, pictures.keep)
    try:
        output.started(connection.name)
        _run(
            runner,
            client,
            session,
            _LinkProblems(connection, client, output, signing),
            stopped,
            options.quit_after,
        )
        for pending in client.unsettled:
            output.problem(wording.given_up(pending.answer.target))
        output.end(session.totals.record(client.rovers, time.monotonic() - started))
    except BrokenPipeError:
        # Python flushes stdout at exit, which would raise again
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    finally:
        runner.close()
        if log is not None:
            with suppress(OSError):  # `LoggedOutput` has reported what could not be written
                log.close()
    return 0


def _run(
    runner: Runner,
    client: OperatorClient,
    session: Session,
    link_problems: _LinkProblems,
    stopped: _Stopped,
    quit_after: float | None,
) -> None:
    keyboard = Keyboard.of(sys.stdin)
    started = time.monotonic()
    while not (stopped or session.quit):
        runner.wait(CYCLE_S, *keyboard.descriptors())
        now = time.monotonic()
        runner.step(now)
        session.step(now)
        link_problems.step(now)
        for line in keyboard.lines():
            session.type(line, now)
        over = quit_after is not None and now - started >= quit_after
        if over or (keyboard.ended and not client.busy):
            break


class _LinkProblems:
    """Reports problems of the link and of signing, and once that no rover is heard on the link."""

    def __init__(
        self,
        connection: OperatorConnection,
        client: OperatorClient,
        output: Output,
        signing: OperatorSigning | None,
    ) -> None:
        self._signing = signing
        self._connection = connection
        self._client = client
        self._output = output
        self._reported_trouble = ""
        self._unsigned: set[int] = set()
        self._quiet_until: float | None = time.monotonic() + SILENT_S

    def step(self, now: float) -> None:
        """Check the link and signing, and report new problems."""
        trouble = self._connection.trouble
        if trouble and trouble != self._reported_trouble:
            self._output.problem(f"{self._connection.name}: {trouble}; trying again")
            self._quiet_until = None
        self._reported_trouble = trouble
        for problem in self._signing.problems() if self._signing is not None else ():
            self._output.problem(problem)
        if self._signing is None:
            signing = {system for system, rover in self._client.rovers.items() if rover.signs}
            for system in signing - self._unsigned:
                self._output.problem(UNSIGNED.format(system))
            self._unsigned |= signing
        if self._quiet_until is not None and now >= self._quiet_until:
            self._quiet_until = None
            if not self._client.rovers:
                self._output.problem(NOBODY)


class _Stopped:
    """Handles SIGTERM and SIGINT; is true once one of them came."""

    def __init__(self) -> None:
        self._received = False
        for number in (signal.SIGTERM, signal.SIGINT):
            signal.signal(number, self._handle)

    def _handle(self, *_: object) -> None:
        self._received = True

    def __bool__(self) -> bool:
        return self._received


class _LogError(OSError):
    """Reports a log that cannot be written."""


def open_log(path: Path) -> TextIO:
    """Open a log for writing. Raises OSError whose text says which."""
    try:
        return path.open("w", encoding="utf-8")
    except OSError as error:
        raise _LogError(f"cannot write the log {path}: {error.strerror}") from error


def _read_script(path: Path) -> Script:
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise ScriptError(f"cannot read the script {path}: {error}") from error
    if len(text) > MAX_SCRIPT_BYTES:
        raise ScriptError(f"the script {path} is over 1 MiB")
    return Script.parse(text)


def _colours(stream: TextIO) -> bool:
    return stream.isatty() and "NO_COLOR" not in os.environ and os.environ.get("TERM") != "dumb"


def identity(text: str) -> int:
    """Read a system or component id. Raises ArgumentTypeError."""
    value = int(text)
    if not 1 <= value <= 255:
        raise argparse.ArgumentTypeError(f"{value} is not an id: 1 to 255")
    return value


def parser() -> argparse.ArgumentParser:
    """Return the parser of the command."""
    root = argparse.ArgumentParser(
        prog="anytraverse-operator", description=__doc__, epilog="Type `help` once it runs."
    )
    root.add_argument("--version", action="version", version=f"%(prog)s {own_version()}")
    root.add_argument(
        "--connect", default="udpin:0.0.0.0:14550", metavar="LINK", help=f"{EXAMPLES} (default %(default)s)"
    )
    root.add_argument("--system", type=identity, default=255, help="our system id (default 255)")
    root.add_argument("--component", type=identity, default=190, help="our component id (default 190)")
    root.add_argument(
        "--signing-key", type=Path, metavar="FILE", help="sign with this key, and believe nothing unsigned"
    )
    root.add_argument("--script", type=Path, metavar="FILE.json", help="answer by this table")
    root.add_argument("--events", action="store_true", help="one JSON object per event, for programs")
    root.add_argument("--log", type=Path, metavar="FILE.jsonl", help="also write those objects to a file")
    root.add_argument(
        "--pictures",
        type=Path,
        default=Path(),
        metavar="FOLDER",
        help="where `picture` puts them",
    )
    root.add_argument("--show", action="store_true", help="open each with the desktop's viewer")
    root.add_argument("--quit-after", type=float, metavar="SECONDS", help="end by itself")
    return root


if __name__ == "__main__":
    sys.exit(main())
