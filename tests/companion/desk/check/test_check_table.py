"""The table of all checks, what the companion makes of it, and what the pages say of it."""

from __future__ import annotations

import json
import logging
import re
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.config import load_config
from companion.desk.check import table
from companion.desk.check.rover import CheckedRover
from companion.desk.check.rules import CheckFinding, failed, passed, warned
from companion.desk.check.table import CHECKS, Check, CheckReport, check, findings

ROOT = Path(__file__).parents[4]


def rover(folder: Path, running: Any) -> CheckedRover:
    path = folder / "companion.toml"
    path.write_text('[web]\nlisten = ""\n[vehicle]\nfile = ""\n[journal]\nfolder = "state"\n')
    return CheckedRover(load_config(str(path)), "", folder / "state", running, inside=True)


def test_the_page_has_a_row_for_each_check_in_this_order() -> None:
    page = (ROOT / "docs/install.md").read_text()
    rows = re.findall(r"^\| ([a-z ]+) \| (.+) \|$", page.partition("| row | what is checked |")[2], re.M)
    assert [(name, what) for name, what in rows[: len(CHECKS)]] == [(one.name, one.what) for one in CHECKS]


_JSON = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=2) | st.dictionaries(st.text(max_size=5), inner, max_size=2),
    max_leaves=4,
)
_FIGURES = st.dictionaries(
    st.sampled_from(
        ["camera", "link", "perceiver", "disk", "computer", "latency_ms", "state", "hold_refused", "version"]
    ),
    _JSON
    | st.dictionaries(st.sampled_from(["state", "rate", "step_ms", "trouble", "rejected", "cpu"]), _JSON),
)


@pytest.mark.slow
@settings(max_examples=60, deadline=None)
@given(_FIGURES)
def test_beside_a_companion_each_check_has_a_row_whatever_its_status_says(
    tmp_path_factory: pytest.TempPathFactory, figures: dict[str, Any]
) -> None:
    found = list(findings(rover(tmp_path_factory.mktemp("rover"), figures)))
    assert list(dict.fromkeys(one.check for one in found)) == [one.name for one in CHECKS]
    assert all(one.text for one in found)


def test_a_check_that_fails_itself_is_a_row_and_the_others_follow(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def broken(_: CheckedRover) -> Iterable[CheckFinding]:
        yield passed("second", "this came before")
        raise ZeroDivisionError("by zero")

    checks = (
        Check("first", lambda _: [warned("first", "know this")], ""),
        Check("second", broken, ""),
        Check("third", lambda _: [passed("third", "well")], ""),
    )
    monkeypatch.setattr(table, "CHECKS", checks)
    path = tmp_path / "companion.toml"
    path.write_text('[web]\nlisten = ""\n[vehicle]\nfile = ""\n[journal]\nfolder = "state"\n')
    assert check(str(path), as_json=True) == 1
    *_, fails, third, summary, last = capsys.readouterr().out.splitlines()
    assert fails.startswith("fail  second")
    assert "ZeroDivisionError: by zero" in fails
    assert third.startswith("pass  third")
    assert summary == "1 to mend, the uppermost first; 1 to know of"
    said = json.loads(last)
    assert (said["ok"], len(said["checks"])) == (False, 4)


@pytest.fixture
def made(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> tuple[CheckReport, Callable[..., None], list[float]]:
    """A report, what its checks find next, and its clock."""
    now = [100.0]
    one = CheckReport(rover(tmp_path, {}).config, lambda: now[0])

    def finds(*found: CheckFinding) -> None:
        monkeypatch.setattr(table, "findings", lambda _: iter(found))

    return one, finds, now


def test_the_report_serves_the_newest_findings_with_their_age(
    made: tuple[CheckReport, Callable[..., None], list[float]],
) -> None:
    one, finds, now = made
    assert one.document() == {"state": "starting"}
    finds(passed("disk", "room"), warned("heat", "82 C"))
    one.refresh({})
    now[0] += 3.5
    rows = [
        {"check": "disk", "verdict": "pass", "text": "room"},
        {"check": "heat", "verdict": "warn", "text": "82 C"},
    ]
    assert one.document() == {"ok": True, "age": 3.5, "checks": rows}
    finds(failed("disk", "full"))
    one.refresh({})
    assert one.document()["ok"] is False
    assert one.document()["age"] == 0.0


def test_what_is_wrong_twice_in_a_row_is_logged_once_a_check(
    made: tuple[CheckReport, Callable[..., None], list[float]], caplog: pytest.LogCaptureFixture
) -> None:
    one, finds, _ = made
    finds(warned("camera", "connecting"), warned("heat", "81 C"))
    one.refresh({})
    for degrees in (82, 83, 84):
        finds(warned("heat", f"{degrees} C"), failed("link", "unplugged"), passed("disk", "room"))
        one.refresh({})
    assert [(record.levelno, record.message) for record in caplog.records] == [
        (logging.WARNING, "check: warn  heat  82 C"),
        (logging.ERROR, "check: fail  link  unplugged"),
    ]
