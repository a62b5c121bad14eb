"""The mutants of the safety path: each is one fault in a file that still compiles."""

from __future__ import annotations

import ast
import json
import sys
from dataclasses import replace
from functools import cache
from pathlib import Path

import pytest

from bench.mutants import __main__
from bench.mutants.__main__ import CHOSEN, figures
from bench.mutants.faults import KINDS, ROOT, SAFETY_PATH, Mutant, chosen

FIXED = [Mutant(**one) for one in json.loads(CHOSEN.read_text())]


@cache
def whole(file: str) -> str:
    """The file as a mutant of it is written, without a fault."""
    return ast.unparse(ast.parse((ROOT / file).read_text())) + "\n"


def test_two_hundred_and_sixty_three_are_fixed_in_a_file() -> None:
    assert len(set(FIXED)) == 263
    assert {one.file for one in FIXED} == set(SAFETY_PATH)
    assert {one.kind for one in FIXED} == set(KINDS)


def test_each_mutant_differs_from_the_file_and_compiles() -> None:
    for mutant in FIXED:
        source = mutant.source()
        compile(source, mutant.file, "exec")
        assert source != whole(mutant.file), mutant


def test_the_tests_that_must_notice_are_there() -> None:
    named = {test for tests in SAFETY_PATH.values() for test in tests}
    assert [test for test in sorted(named) if not (ROOT / test).exists()] == []


def test_a_mutant_whose_line_is_gone_says_so() -> None:
    with pytest.raises(LookupError, match="no function"):
        Mutant("anytraverse/roi.py", "gone", "condition", 0, "").source()
    with pytest.raises(LookupError, match="no condition 99"):
        replace(FIXED[0], kind="condition", nth=99).source()


def test_a_mutant_whose_line_is_gone_counts_as_not_caught() -> None:
    assert figures({4: "gone: no function", 3: "survived", 2: "hung", 1: "caught"}) == {
        "mutants": 4,
        "caught": 2,
        "outcomes": {1: "caught", 2: "hung", 3: "survived", 4: "gone: no function"},
    }


def test_tests_that_fail_without_a_fault_are_named_and_not_believed(tmp_path: Path) -> None:
    (tmp_path / "test_good.py").write_text("def test_good(): pass\n")
    (tmp_path / "test_bad.py").write_text("def test_bad(): assert False\n")
    assert __main__._failing([("test_good.py",), ("test_good.py", "test_bad.py")], tmp_path) == [
        ("test_good.py", "test_bad.py")
    ]


def test_a_fault_whose_line_was_changed_is_gone_and_is_put_into_no_other_line() -> None:
    known = Mutant("companion/calls/faults.py", "Faults.refuses", "boundary", 0, "< WITHIN")
    assert "<= WITHIN" in known.source()
    with pytest.raises(LookupError, match="no boundary 0"):
        replace(known, line="< WITHIN_LONG_AGO").source()


def test_more_of_some_files_are_added_at_the_end_and_none_twice(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    file = "companion/vision/answer_queue.py"
    first, all_of_it = chosen(5, 1, [file]), chosen(99, 1, [file])
    written = tmp_path / "mutants.json"
    written.write_text(json.dumps([one.figures() for one in first]))
    monkeypatch.setattr(__main__, "CHOSEN", written)
    monkeypatch.setattr(sys, "argv", ["mutants", "--choose", "99", "--files", file])
    assert __main__.main() == 0
    found = [Mutant(**one) for one in json.loads(written.read_text())]
    assert found[:5] == first
    assert len(found) == len(set(found)) == len(all_of_it)
    assert set(found) == set(all_of_it)


def test_a_boundary_moves_an_operand_goes_and_an_assignment_is_false() -> None:
    boundary, operand, assignment = FIXED[200:203]
    assert "report.reported_at < self._unknown_until" in boundary.source()
    assert "at < self._first_go_at" not in operand.source()
    assert "late = False" in assignment.source()
