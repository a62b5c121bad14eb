"""The log on stderr: nobody waits for its reader, and what a reader missed is said."""

from __future__ import annotations

import io
import logging
import os
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import pytest

from companion.system import log_lines
from companion.system.log_lines import MOST_WAITING, StderrHandler, brief
from tests.waiting import fill

ROOT = Path(__file__).resolve().parents[3]
PATIENCE = 20.0


@pytest.fixture
def pipe() -> Iterator[tuple[io.FileIO, int]]:
    """A pipe: the end of the reader, and that of the log."""
    reader, log = os.pipe()
    with io.FileIO(reader, "r") as file:
        yield file, log
        os.close(log)


def record(text: str, *given: object) -> logging.LogRecord:
    """A record of the log."""
    return logging.LogRecord("companion.test", logging.INFO, "", 0, text, given, None)


def read(file: io.FileIO, last: str) -> list[str]:
    """Read lines up to the last one."""
    found = b""
    while not found.endswith(f"{last}\n".encode()):
        found += file.read(1 << 16)
    return found.decode().splitlines()


def test_a_reader_who_stands_delays_no_line_and_is_told_how_many_it_missed(
    pipe: tuple[io.FileIO, int],
) -> None:
    reader, log = pipe
    filled = fill(log)
    handler = StderrHandler(log)
    handler.handle(record("line %d", 0))
    while not handler._lines.empty():
        time.sleep(0.001)
    for number in range(1, MOST_WAITING + 501):
        handler.handle(record("line %d", number))
    assert len(reader.read(filled)) == filled
    lines = read(reader, f"line {MOST_WAITING}")
    handler.handle(record("and on"))
    lines += read(reader, "and on")
    assert lines[0] == "line 0"
    assert "500 log lines were dropped: nobody reads stderr" in lines
    lines.remove("500 log lines were dropped: nobody reads stderr")
    assert lines == [*(f"line {number}" for number in range(MOST_WAITING + 1)), "and on"]


def test_the_end_waits_for_the_lines_but_not_for_a_reader_who_stands(
    pipe: tuple[io.FileIO, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    reader, log = pipe
    handler = StderrHandler(log)
    handler.handle(record("read"))
    handler.flush()
    assert reader.read(64) == b"read\n"
    fill(log)
    monkeypatch.setattr(log_lines, "LAST_LINES", 0.05)
    handler.handle(record("not read"))
    began = time.monotonic()
    handler.flush()
    assert 0.05 <= time.monotonic() - began < PATIENCE


def test_a_line_that_cannot_be_made_costs_that_line_only(pipe: tuple[io.FileIO, int]) -> None:
    reader, log = pipe
    handler = StderrHandler(log)
    handler.handle(record("%d lines", "two"))
    handler.handle(record("%d lines", 2))
    wrong, right = read(reader, "2 lines")
    assert wrong.startswith("'%d lines' cannot be logged: TypeError")
    assert right == "2 lines"


def test_only_the_thread_that_writes_reads_the_source_for_a_traceback(
    pipe: tuple[io.FileIO, int], monkeypatch: pytest.MonkeyPatch
) -> None:
    reader, log = pipe
    formats = set[str]()
    handler = StderrHandler(log)

    class Noting(logging.Formatter):
        def formatException(self, ei: object) -> str:  # noqa: N802
            formats.add(threading.current_thread().name)
            return super().formatException(ei)  # type: ignore[arg-type]

    handler.setFormatter(Noting())
    try:
        raise ValueError("wrong")
    except ValueError:
        raised = logging.LogRecord("companion.test", logging.ERROR, "", 0, "it failed", (), sys.exc_info())
    handler.handle(raised)
    lines = read(reader, "ValueError: wrong")
    assert (lines[:2], lines[-1]) == (
        ["it failed", "Traceback (most recent call last):"],
        "ValueError: wrong",
    )
    assert formats == {"stderr"}
    monkeypatch.setattr("linecache.getline", lambda *_: pytest.fail("it reads the source"))
    text = brief(raised).splitlines()
    assert (text[0], text[-1]) == ("it failed", "ValueError: wrong")
    assert text[1].endswith("in test_only_the_thread_that_writes_reads_the_source_for_a_traceback")


_ENDS = """
import logging, sys
from companion.system.log_lines import end_process, log_to_stderr
log_to_stderr(logging.INFO)
try:
    raise ValueError("wrong")
except ValueError:
    logging.critical("it failed", exc_info=True)
end_process(3)
"""


def test_a_process_that_ends_has_said_why() -> None:
    done = subprocess.run(
        [sys.executable, "-c", _ENDS], cwd=ROOT, capture_output=True, text=True, timeout=PATIENCE, check=False
    )
    assert done.returncode == 3
    assert "CRITICAL root: it failed\nTraceback" in done.stderr
    assert done.stderr.endswith("ValueError: wrong\n")


_ABORTS = """
import os
from companion.system.log_lines import dump_when_aborted
dump_when_aborted()
os.abort()
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("command", "code"),
    [
        (("-c", _ENDS), 3),
        (("-c", _ABORTS), -signal.SIGABRT),
        (("-m", "companion", "run", "there-is-none.toml"), 2),
    ],
    ids=["an error", "an abort", "what the user can mend"],
)
def test_a_process_ends_though_nobody_reads_why(
    command: tuple[str, ...], code: int, pipe: tuple[io.FileIO, int]
) -> None:
    _, log = pipe
    fill(log)
    done = subprocess.run([sys.executable, *command], cwd=ROOT, stderr=log, timeout=PATIENCE, check=False)
    assert done.returncode == code


def test_a_process_that_is_aborted_says_where_it_was() -> None:
    done = subprocess.run(
        [sys.executable, "-c", _ABORTS],
        cwd=ROOT,
        capture_output=True,
        text=True,
        timeout=PATIENCE,
        check=False,
    )
    assert done.stderr.startswith("Fatal Python error: Aborted")
    assert 'File "<string>", line 5 in <module>' in done.stderr
