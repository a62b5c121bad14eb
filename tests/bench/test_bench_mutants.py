"""The mutants of the safety path: each is one fault in a file that still compiles."""

from __future__ import annotations

import ast
import json
from dataclasses import replace
from functools import cache

import pytest

from bench.mutants.__main__ import CHOSEN, figures
from bench.mutants.faults import KINDS, ROOT, SAFETY_PATH, Mutant, chosen

COUNT = 60


@cache
def some() -> list[Mutant]:
    """What the bench would take; found by reading the whole safety path."""
    return chosen(COUNT, seed=2)


@pytest.mark.parametrize("which", range(COUNT))
def test_a_mutant_differs_from_the_file_and_compiles(which: int) -> None:
    mutant = some()[which]
    source = mutant.source()
    compile(source, mutant.file, "exec")
    assert source != ast.unparse(ast.parse((ROOT / mutant.file).read_text())) + "\n", mutant


def test_the_choice_is_the_same_for_the_same_seed_and_takes_from_every_file() -> None:
    assert chosen(COUNT, seed=2) == some()
    assert {one.file for one in some()} == set(SAFETY_PATH)
    assert {one.kind for one in chosen(400, seed=1)} == set(KINDS)


def test_what_is_gone_is_said() -> None:
    with pytest.raises(LookupError, match="no function"):
        Mutant("anytraverse/roi.py", "gone", "condition", 0, "").source()
    with pytest.raises(LookupError, match="no condition 99"):
        Mutant(some()[0].file, some()[0].function, "condition", 99, "").source()


def test_what_is_gone_counts_as_caught_by_nobody() -> None:
    assert figures({4: "gone: no function", 3: "survived", 2: "hung", 1: "caught"}) == {
        "mutants": 4,
        "caught": 2,
        "outcomes": {1: "caught", 2: "hung", 3: "survived", 4: "gone: no function"},
    }


def test_a_fault_whose_line_was_changed_is_gone_and_is_put_into_no_other_line() -> None:
    known = Mutant("companion/calls/faults.py", "Faults.refuses", "boundary", 0, "< WITHIN")
    assert "<= WITHIN" in known.source()
    with pytest.raises(LookupError, match="no boundary 0"):
        replace(known, line="< WITHIN_LONG_AGO").source()


def test_two_hundred_and_three_of_a_review_are_fixed_in_a_file() -> None:
    found = [Mutant(**one) for one in json.loads(CHOSEN.read_text())]
    assert len(set(found)) == 203
    assert {one.file for one in found} == set(SAFETY_PATH)
    assert all(one.source() for one in found), "they are there"


def test_a_boundary_moves_an_operand_goes_and_an_assignment_is_false() -> None:
    *_, boundary, operand, assignment = (Mutant(**one) for one in json.loads(CHOSEN.read_text()))
    assert "report.reported_at < self._unknown_until" in boundary.source()
    assert "at < self._first_go_at" not in operand.source()
    assert "late = False" in assignment.source()
