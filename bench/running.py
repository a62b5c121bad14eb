"""Runs one benchmark in a process of its own, with a deadline, and tells what became of it."""

from __future__ import annotations

import os
import shlex
import signal
import subprocess
import sys
import time
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from statistics import median

from bench.benches import OUT, Bench
from bench.machine import ROOT, describe_run
from bench.result import (
    FAILED,
    RAN,
    SKIPPED,
    BenchResult,
    MeasuredFigure,
    RubbishError,
    figures_of,
    last_line,
)

SLACK = 60.0
"""Seconds that any benchmark may take beyond three times what it usually takes."""
_ENDING = 15.0
"""Seconds that a benchmark gets to end after SIGTERM: some print what they have."""
_READ = 4 << 20
"""Bytes at the end of an output that are read, at most."""


def run(name: str, bench: Bench, out: Path, *, quick: bool = False, rounds: int = 1) -> BenchResult:
    """Runs a benchmark so often; its output goes to NAME.log and NAME.err in `out`, a folder.

    Its deadline is three times what it takes, and `SLACK`. With several rounds each figure is the median,
    and its spread is from the least to the greatest. An exit code that is not 0 is a failure; what it printed
    is told nevertheless.
    """
    arguments = bench.quick if quick else bench.arguments
    asked = ["-m", bench.module, *(arguments or ())]
    typed = shlex.join(["python", *asked]).replace(OUT, "OUT")
    result = BenchResult(name, bench.measures, typed, quick, SKIPPED, "", 0.0, describe_run())
    if arguments is None:
        return replace(result, why=f"has no quick form: python -m bench {name}")
    if missing := bench.needs():
        return replace(result, why=missing)
    command = [sys.executable, *(one.replace(OUT, str(out)) for one in asked)]
    begun = time.monotonic()
    taken: list[BenchResult] = []
    for _ in range(rounds):
        taken.append(_once(result, bench, command, out, quick=quick))
        if taken[-1].state != RAN:
            break
    seconds = round(time.monotonic() - begun, 2)
    return replace(taken[-1], figures=_together(taken), seconds=seconds)


def _once(result: BenchResult, bench: Bench, command: list[str], out: Path, *, quick: bool) -> BenchResult:
    deadline = SLACK + 3 * 60.0 * bench.minutes[quick]
    log, errors = out / f"{result.name}.log", out / f"{result.name}.err"
    code = _process(command, log, errors, deadline)
    if code is None:
        return replace(result, state=FAILED, why=f"ended after {deadline:.0f} s, its deadline: see {log}")
    try:
        told = last_line(_end_of(log))
        found = figures_of(told, bench.figures)
    except RubbishError as error:
        ended = f"it ended with {code}, and " if code else ""
        return replace(result, state=FAILED, why=f"{ended}{error}{_last_words(errors, code)}")
    result = replace(result, told=told, figures=found, series=tuple(told.pop("series", ())))
    if "skipped" in told:
        return replace(result, state=SKIPPED, why=str(told["skipped"]))
    if code:
        return replace(result, state=FAILED, why=f"it ended with {code}{_last_words(errors, code)}")
    return replace(result, state=RAN)


def _process(command: list[str], log: Path, errors: Path, deadline: float) -> int | None:
    """Runs a command with all that it starts; returns its exit code, None where it was ended."""
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join([str(ROOT), *_given_path()])}
    with log.open("wb") as output, errors.open("wb") as said:
        process = subprocess.Popen(
            command,
            cwd=ROOT,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=output,
            stderr=said,
            start_new_session=True,
        )
        try:
            return process.wait(deadline)
        except subprocess.TimeoutExpired:
            return None
        finally:
            _end(process)


def _given_path() -> list[str]:
    return [one for one in os.environ.get("PYTHONPATH", "").split(os.pathsep) if one]


def _end(process: subprocess.Popen[bytes]) -> None:
    """Ends the process, and whatever it left behind."""
    if process.poll() is None:
        process.terminate()
        with suppress(subprocess.TimeoutExpired):
            process.wait(_ENDING)
    with suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    process.wait()


def _end_of(path: Path) -> str:
    with path.open("rb") as file:
        file.seek(max(0, path.stat().st_size - _READ))
        return file.read().decode("utf-8", errors="replace")


def _last_words(errors: Path, code: int) -> str:
    """Returns the last line that it wrote to stderr, if it failed."""
    lines = _end_of(errors).strip().splitlines() if code else []
    return f": {lines[-1][:300]}" if lines else ""


def _together(rounds: list[BenchResult]) -> dict[str, MeasuredFigure]:
    if len(rounds) == 1:
        return dict(rounds[0].figures)
    found = {}
    for what, figure in rounds[-1].figures.items():
        values = [one.figures[what].value for one in rounds if what in one.figures]
        found[what] = replace(figure, value=median(values), low=min(values), high=max(values))
    return found
