"""The page of results, and the comparison with earlier results."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest

import bench.__main__
from bench.benches import BENCHES, Bench
from bench.comparing import ALIKE, BETTER, UNKNOWN, WORSE, changes, other_machine
from bench.page import page
from bench.result import FAILED, RAN, SKIPPED, BenchResult, MeasuredFigure, Quoted, read_results
from bench.series import PlottedSeries

MACHINE = {
    "cpu": "a fast one",
    "cores": 2,
    "architecture": "riscv",
    "load": 0.5,
    "commit": "abc",
    "when": "T",
}
RESULT = BenchResult(
    "link", "a radio", "python -m bench.link", quick=False, state=RAN, why="", seconds=3.0, run=MACHINE
)
LINES: dict[str, list[list[float]]] = {"built in": [[1, 5, 4, 6], [2, 5, 5, 5], [16, 80, 70, 90]]}


def result(name: str = "link", /, **figures: MeasuredFigure) -> BenchResult:
    return replace(RESULT, name=name, figures=figures)


def figure(value: float, low: float | None, high: float | None, better: str = "less") -> MeasuredFigure:
    return MeasuredFigure(value, "ms", better, low, high)


@pytest.mark.parametrize(
    ("before", "now", "verdict"),
    [
        (figure(5, 4, 6), figure(8, 7, 9), WORSE),
        (figure(8, 7, 9), figure(5, 4, 6), BETTER),
        (figure(5, 4, 6), figure(7, 6, 8), ALIKE),
        (figure(5, 4, 6, "more"), figure(8, 7, 9, "more"), BETTER),
        (figure(8, 7, 9, "more"), figure(5, 4, 6, "more"), WORSE),
        (figure(100, 99, 101), figure(112, 111, 113), ALIKE),
        (figure(5, None, None), figure(50, 49, 51), UNKNOWN),
        (figure(0, None, None), figure(0, None, None), ALIKE),
    ],
)
def test_a_figure_is_worse_only_beyond_the_spread_of_both_and_what_runs_differ_by(
    before: MeasuredFigure, now: MeasuredFigure, verdict: str
) -> None:
    (change,) = changes({"link": result(step=now)}, {"link": result(step=before)})
    assert change.verdict == verdict


def test_only_figures_of_the_same_command_and_unit_that_have_a_better_side_are_compared() -> None:
    now = result(
        step=figure(5, 4, 6), count=MeasuredFigure(7, "frames"), other=MeasuredFigure(1, "s", "less")
    )
    before = result(
        step=figure(5, 4, 6), count=MeasuredFigure(9, "frames"), other=MeasuredFigure(1, "ms", "less")
    )
    assert [one.what for one in changes({"link": now}, {"link": before})] == ["step"]
    assert not list(changes({"link": now}, {"link": replace(before, command="python -m bench.link --quick")}))
    assert not list(changes({"link": now}, {"link": replace(before, state=FAILED)}))
    assert not list(changes({"link": now}, {"vision": before}))


def test_points_of_plots_are_compared_but_not_samples_over_time() -> None:
    def plotted(factor: float, count: int) -> BenchResult:
        points = [[float(x), x * factor, x * factor, x * factor] for x in range(1, count + 1)]
        return replace(RESULT, series=(PlottedSeries("T", "words", "ms", {"a": points}).as_json(),))

    changed = list(changes({"link": plotted(2, 3)}, {"link": plotted(1, 3)}))
    assert [one.what for one in changed] == ["T: a, 1.0 words", "T: a, 2.0 words", "T: a, 3.0 words"]
    assert {one.verdict for one in changed} == {WORSE}
    assert not list(changes({"link": plotted(2, 50)}, {"link": plotted(1, 50)}))


def test_another_machine_is_told() -> None:
    slow = replace(RESULT, run={**MACHINE, "cpu": "slow"})
    assert other_machine({"link": RESULT}, {"link": slow, "vision": RESULT}) == "cpu a fast one, before slow"
    assert not other_machine({"link": RESULT}, {"link": RESULT})


def test_the_page_tells_what_ran_what_was_skipped_and_what_failed_and_needs_no_network() -> None:
    plotted = PlottedSeries("<Time>", "words", "ms", LINES).as_json()
    results = {
        "link": replace(result(step=figure(5, 4, 6)), series=(plotted,)),
        "service": replace(RESULT, name="service", state=SKIPPED, why="needs root: <type> sudo"),
        "vision": replace(RESULT, name="vision", state=FAILED, why="ended after 60 s & never spoke"),
    }
    text = page(results)
    for told in ("5 ms [4, 6]", "needs root: &lt;type&gt; sudo", "60 s &amp; never spoke", "&lt;Time&gt;"):
        assert told in text
    assert "cpu a fast one, cores 2" in text
    assert text.count('class="plot"') == 1
    own = text.partition("<script>")[0]
    assert not re.search(r"(?<!\$schema\":\")https?://|<link|src=|@import|url\(", own)


def test_a_run_goes_on_after_a_failure_and_ends_with_1(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "of_this_test.py").write_text("import sys\nprint('{\"ms\": %s}' % sys.argv[1])")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    for name, argument in (("vision", "quickly"), ("house", "3")):
        figures = (Quoted("ms", "a step", "ms", "less"),)
        monkeypatch.setitem(
            BENCHES, name, Bench("of_this_test", "a test", (1, 1), (argument,), None, str, figures)
        )
    out = tmp_path / "out"
    assert bench.__main__.main(["vision", "house", "--out", str(out)]) == 1
    assert [one.state for one in read_results(out).values()] == [RAN, FAILED]
    assert "its last line is no JSON object" in (out / "index.html").read_text()
    assert bench.__main__.main(["house", "--out", str(out), "--against", str(out)]) == 0
    assert "Compared with" in (out / "index.html").read_text()
    assert "the page: " in capsys.readouterr().out
    for wrong in (["speed"], ["house", "--rounds", "0"], ["house", "--against", str(tmp_path)]):
        with pytest.raises(SystemExit):
            bench.__main__.main(wrong)
