"""The fault table: what docs/faults.md says of it, how rows are judged, and a few of them for real."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from pathlib import Path
from typing import Any

import pytest

from bench.faults.produce import produce
from bench.faults.report import RESULTS, document, judged, keep, read, summed
from bench.faults.row import HOLD_WITHIN, Row, RowOutcome, Work
from bench.faults.stages import SCRIPT_WITHIN, repeated
from bench.faults.table import ROWS, chosen
from bench.stopping.jobs import TRIES, Job
from bench.stopping.limits import script_timeout
from bench.stopping.scenes import Seen, follows
from bench.stopping.stage import Disturbed
from bench.stopping.wire import Beat, Wire
from companion.config import load_config
from companion.sim.demo.config import write_config
from companion.wire.ids import State

ROOT = Path(__file__).parents[2]
FEW = (
    "camera absent at boot",
    "camera unplugged, a program's pipe",
    "link lost with a call open",
    "autopilot reboots while it drives",
)
"""Rows that are produced here, once each; `make faults` produces all, as often as they say."""


@pytest.fixture(scope="module")
def few(tmp_path_factory: pytest.TempPathFactory) -> dict[str, dict[str, Any]]:
    """These rows in their short form, side by side."""
    pytest.importorskip("lupa.lua53", reason="the script on the autopilot runs in Lua 5.3")
    out, cancelled = tmp_path_factory.mktemp("faults"), threading.Event()
    rows = [row for row in ROWS if row.fault in FEW]
    with pytest.MonkeyPatch.context() as patched, ThreadPoolExecutor(len(rows)) as pool:
        patched.setenv("PYTHONPATH", str(ROOT))
        jobs = [pool.submit(produce, row, Work(out / row.fault, 1, short=True), cancelled) for row in rows]
        try:
            found = [job.result() for job in jobs]
        finally:
            cancelled.set()
    return {row.fault: judged(row, one, short=True) for row, one in zip(rows, found, strict=True)}


@pytest.mark.parametrize("fault", FEW)
def test_a_fault_ends_in_its_safe_state(few: dict[str, dict[str, Any]], fault: str) -> None:
    assert few[fault]["safe"], few[fault]
    assert few[fault]["runs"] > 0


def test_the_document_has_the_rows_of_the_table_and_what_was_measured_and_no_others() -> None:
    text = (ROOT / "docs/faults.md").read_text(encoding="utf-8")
    table = document(ROWS, read(RESULTS))
    assert table in text, "python -m bench.faults.report writes it"
    shown = [line for line in text.splitlines() if line.startswith("|")]
    assert shown == table.splitlines()


def test_every_row_has_a_name_of_its_own_and_is_found_by_a_part_of_it() -> None:
    assert len({row.fault for row in ROWS}) == len(ROWS)
    assert [row.fault for row in chosen(["FROZEN, with"])] == ["camera frozen, with a clock in the picture"]
    assert chosen([]) == list(ROWS)
    with pytest.raises(ValueError, match="no row has 'meteorite' in its name: camera absent"):
        chosen(["meteorite"])


def test_the_limits_are_of_what_the_stages_and_the_script_have(tmp_path: Path) -> None:
    path = write_config(tmp_path, camera="field:127.0.0.1:1", link="udpout:127.0.0.1:9", policy="hold")
    assert load_config(str(path)).freshness + 1.0 == HOLD_WITHIN
    assert script_timeout() + 0.5 == SCRIPT_WITHIN


def row(**more: Any) -> Row:
    return Row("fault", "how", "what follows", lambda _: RowOutcome(1), 2.0, 12.0, **more)


@pytest.mark.parametrize(
    ("outcome", "wrong"),
    [
        (RowOutcome(3, (), 1.2, 4.0), None),
        (RowOutcome(3, (), 2.1, 4.0), ["hold after 2.10 s, limit 2 s"]),
        (RowOutcome(3, (), 1.2, 12.5), ["return after 12.50 s, limit 12 s"]),
        (RowOutcome(3, (), None, 4.0), ["no hold was measured"]),
        (RowOutcome(3, ("not stopped",), 1.2, 4.0), ["not stopped"]),
        (RowOutcome(0, (), 1.2, 4.0), ["never produced"]),
    ],
)
def test_a_row_is_safe_where_every_run_ended_in_its_state_and_in_time(
    outcome: RowOutcome, wrong: list[str] | None
) -> None:
    found = judged(row(), outcome, short=False)
    assert (found["safe"], found.get("wrong")) == (wrong is None, wrong)


def test_the_short_form_judges_no_times() -> None:
    assert judged(row(), RowOutcome(1, (), 9.0, None), short=True)["safe"]
    assert not judged(row(), RowOutcome(1, ("not stopped",), 1.0, 1.0), short=True)["safe"]


def test_a_stated_exception_is_not_safe_and_not_wrong_while_it_is_as_stated() -> None:
    px4 = next(one for one in ROWS if one.exception)
    assert px4.fault == "companion dead on PX4"
    as_stated = judged(px4, RowOutcome(3, (), None, 2.0, "DRIVES ON"), short=False)
    assert not as_stated["safe"]
    assert "wrong" not in as_stated
    assert judged(px4, RowOutcome(3, ("it stopped",), None, 2.0), short=False)["wrong"] == ["it stopped"]
    assert "🔴 **NOT SAFE**: DRIVES ON" in document([px4], [as_stated])
    assert summed([as_stated, judged(row(), RowOutcome(1, (), 1.5, 3.0), short=False)]) == {
        "rows": [as_stated, judged(row(), RowOutcome(1, (), 1.5, 3.0), short=False)],
        "safe": 1,
        "worst_hold_s": 1.5,
        "worst_return_s": 3.0,
    }


def test_a_row_says_how_often_it_may_fail_at_most() -> None:
    clean = judged(row(), RowOutcome(59, (), 1.2, 4.0), short=False)
    assert "| 59, <4.96% |" in document([row()], [clean])
    spoilt = judged(row(), RowOutcome(5, ("not stopped",), 1.2, 4.0), short=False)
    assert "| 5, <65.8% |" in document([row()], [spoilt])
    never = judged(row(), RowOutcome(0, ("did not end",), None, None), short=False)
    assert "| 0 |" in document([row()], [never])


def test_a_row_is_repeated_as_often_as_is_asked(tmp_path: Path) -> None:
    assert list(Work(tmp_path, 3, short=False).seeds(5)) == [3, 4, 5, 6, 7]
    assert list(Work(tmp_path, 3, short=False, runs=2).seeds(5)) == [3, 4]
    assert list(Work(tmp_path, 3, short=True, runs=2).seeds(5)) == [3]


def test_results_keep_the_rows_of_earlier_runs_and_forget_faults_that_are_not_in_the_table(
    tmp_path: Path,
) -> None:
    path = tmp_path / "faults.json"
    first, second = (judged(one, RowOutcome(1, (), 1.0, 1.0), short=False) for one in ROWS[:2])
    keep(path, [second, {**second, "fault": "of an earlier table"}], "one")
    keep(path, [first], "two")
    assert [one["fault"] for one in read(path)] == [ROWS[0].fault, ROWS[1].fault]
    assert all(one["commit"] and one["date"] for one in read(path))


def test_a_row_that_raises_is_wrong_and_says_why(tmp_path: Path) -> None:
    found = produce(row(), Work(tmp_path / "row", 1, short=True), threading.Event())
    assert found.runs == 0
    assert "ValueError" in found.wrong[0]


@pytest.mark.parametrize(("after_the_fault", "plays"), [(True, 1), (False, TRIES)])
def test_what_does_not_follow_is_wrong_at_once_and_only_a_disturbed_start_is_begun_anew(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, after_the_fault: bool, plays: int
) -> None:
    monkeypatch.setattr(Job, "stage", lambda *_: nullcontext())
    played = []

    def play(_stage: Any, _random: Any) -> Seen:
        played.append(1)
        with follows() if after_the_fault else nullcontext():
            raise Disturbed("mode HOLD: not within 10 s")

    found = repeated(5, lambda job, random: job.plan(random), play)(Work(tmp_path, 1, short=True))
    assert (found.runs, found.wrong, len(played)) == (1, ("mode HOLD: not within 10 s",), plays)


def test_ended_early_it_prints_what_it_has_and_leaves_no_process() -> None:
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-m", "bench.faults", "--only", "service killed", "vision hung in native code"]
    bench = subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment, cwd=ROOT)
    assert bench.stdout is not None
    assert "service killed" in bench.stdout.readline()
    bench.send_signal(signal.SIGINT)
    figures = json.loads(bench.stdout.read().splitlines()[-1])
    assert [one["fault"] for one in figures["rows"]] == ["service killed"]
    assert bench.wait(10.0) == 128 + signal.SIGINT


@pytest.mark.parametrize(
    ("beats", "since", "expected"),
    [
        ("1 OK, 2 OK, 3 FAULT, 4 OK", 1.5, 2.5),
        ("1 OK, 2 OK, 3 OK", 1.5, None),
        ("1 OK, 2 FAULT, 3 OK", 2.5, 0.5),
        ("1 FAULT, 2 OK, 3 OK", 2.5, None),
        ("1 OK, 4 OK", 3.5, 0.5),
        ("1 OK, 2 lost, 3 lost, 4 CALLING", 3.5, 0.5),
        ("1 OK, 4 STARTING, 5 HOLDING", 3.5, 1.5),
        ("1 OK, 2 FAULT, 3 FAULT", 2.5, None),
    ],
)
def test_well_again_is_the_first_heartbeat_that_is_believed_after_a_fault_or_silence(
    beats: str, since: float, expected: float | None
) -> None:
    wire = Wire(9)
    try:
        for at, state in (beat.split() for beat in beats.split(", ")):
            passed = state != "lost"
            wire.beats.append(Beat(float(at), State[state] if passed else State.OK, passed))
        assert wire.well_again(since) == expected
        assert wire.believed(1.5) == (None if beats.startswith("1 FAULT") else 1.0)
    finally:
        wire.close()
