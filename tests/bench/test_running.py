"""One benchmark in a process of its own: it runs, is skipped, fails, hangs or prints rubbish."""

from __future__ import annotations

import json
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest

from bench.benches import Bench
from bench.result import FAILED, RAN, SKIPPED, Quoted
from bench.running import run
from tests.waiting import is_gone, wait_for

MakeBench = Callable[[str], Bench]


@pytest.fixture
def bench_of(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> MakeBench:
    """Makes a benchmark of a program."""
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))

    def make(program: str) -> Bench:
        (tmp_path / "of_a_test.py").write_text(program)
        return Bench("of_a_test", "what a test does", (0, 0), figures=(Quoted("ms", "a step", "ms", "less"),))

    return make


def test_what_ran_has_figures_with_units_and_says_where_and_when(bench_of: MakeBench, tmp_path: Path) -> None:
    bench = bench_of('import sys\nprint("step")\nprint(\'{"ms": 2.5, "arguments": %d}\' % len(sys.argv))')
    result = run("mine", replace(bench, arguments=("--fast", "two words")), tmp_path)
    assert (result.state, result.why) == (RAN, "")
    assert result.command == "python -m of_a_test --fast 'two words'"
    assert (result.figures["a step"].value, result.figures["a step"].unit) == (2.5, "ms")
    assert result.told == {"ms": 2.5, "arguments": 3}
    assert result.seconds > 0
    assert {"commit", "when", "load", "cpu", "cores", "python", "numpy", "os"} <= result.run.keys()
    assert (tmp_path / "mine.log").read_text().startswith("step")


@pytest.mark.parametrize(
    ("program", "why"),
    [
        ("print('all well')", "its last line is no JSON object: all well"),
        ("print('[1, 2]')", "its last line is no JSON object: [1, 2]"),
        ("", "it printed nothing"),
        ("import os; os.write(1, b'\\xff\\xfe{')", "its last line is no JSON object"),
        ('print(\'{"ms": "fast"}\')', "ms is 'fast', and no number"),
        ("print('{\"ms\": NaN}')", "ms is nan, and no number"),
        ("print('{\"ms\": true}')", "ms is True, and no number"),
        ("print('{}')", "its last line has none of its figures, such as ms"),
        ('print(\'{"ms": 1, "series": [{}]}\')', "its series cannot be read: KeyError('lines')"),
        ("raise SystemExit('no camera')", "it ended with 1, and it printed nothing: no camera"),
    ],
)
def test_rubbish_is_a_failure_that_says_what_was_printed(
    bench_of: MakeBench, tmp_path: Path, program: str, why: str
) -> None:
    result = run("mine", bench_of(program), tmp_path)
    assert result.state == FAILED
    assert result.why.startswith(why)
    assert not result.figures


def test_an_exit_code_is_a_failure_whose_figures_are_told(bench_of: MakeBench, tmp_path: Path) -> None:
    program = "import sys\nprint('{\"ms\": 7}')\nprint('too late', file=sys.stderr)\nsys.exit(1)"
    result = run("mine", bench_of(program), tmp_path, rounds=3)
    assert (result.state, result.why) == (FAILED, "it ended with 1: too late")
    assert result.figures["a step"].value == 7


def test_one_that_hangs_is_ended_with_all_that_it_started(
    bench_of: MakeBench, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("bench.running.SLACK", 1.0)
    monkeypatch.setattr("bench.running._ENDING", 0.2)
    program = (
        "import signal, subprocess, sys, time\n"
        "signal.signal(signal.SIGTERM, signal.SIG_IGN)\n"
        "child = subprocess.Popen([sys.executable, '-c', 'import time; time.sleep(60)'])\n"
        "print(child.pid, flush=True)\ntime.sleep(60)"
    )
    began = time.monotonic()
    result = run("mine", bench_of(program), tmp_path)
    assert time.monotonic() - began < 20
    assert result.state == FAILED
    assert result.why.startswith("ended after 1 s, its deadline")
    child = int((tmp_path / "mine.log").read_text())
    wait_for(lambda: is_gone(child), 5.0)


def test_what_is_missing_here_is_the_reason_to_skip_it(bench_of: MakeBench, tmp_path: Path) -> None:
    bench = bench_of("raise SystemExit(1)")
    result = run("mine", replace(bench, needs=lambda: "needs a rover: buy one"), tmp_path)
    assert (result.state, result.why) == (SKIPPED, "needs a rover: buy one")
    result = run("mine", bench, tmp_path, quick=True)
    assert (result.state, result.why) == (SKIPPED, "has no quick form: python -m bench mine")
    result = run("mine", bench_of('print(\'{"skipped": "no frames"}\')'), tmp_path)
    assert (result.state, result.why) == (SKIPPED, "no frames")


def test_several_rounds_give_the_median_and_the_spread(bench_of: MakeBench, tmp_path: Path) -> None:
    program = (
        "from pathlib import Path\nseen = Path(__file__).with_name('seen')\n"
        "had = len(seen.read_text()) if seen.exists() else 0\nseen.write_text('x' * (had + 1))\n"
        "print('{\"ms\": %d}' % [5, 3, 8][had])"
    )
    figure = run("mine", bench_of(program), tmp_path, rounds=3).figures["a step"]
    assert (figure.value, figure.low, figure.high) == (5, 3, 8)


def test_results_are_read_back_as_they_were_written(bench_of: MakeBench, tmp_path: Path) -> None:
    from bench.result import read_results, write_result

    line: dict[str, Any] = {
        "ms": 2,
        "series": [{"title": "T", "x": "n", "unit": "ms", "lines": {"a": [[1, 2, 1, 3]]}}],
    }
    result = run("mine", bench_of(f"print({json.dumps(line)!r})"), tmp_path)
    write_result(tmp_path, result)
    for name, content in (("other", '{"figures": {}}'), ("torn", '{"form": 1, "na'), ("list", "[]")):
        (tmp_path / f"{name}.json").write_text(content)
    (tmp_path / "fields.json").write_text('{"form": 1, "figures": {}, "series": [], "more": 1}')
    assert read_results(tmp_path) == {"mine": result}
    assert result.series == tuple(line["series"])
    assert result.told == {"ms": 2}
