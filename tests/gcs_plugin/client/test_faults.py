"""The faults of one call stand in one line with a count."""

from __future__ import annotations

from hypothesis import given
from hypothesis import strategies as st

from gcs_plugin.client.faults import MOST_NAMES, MOST_SUBJECTS, FaultTally


def test_faults_that_take_turns_are_one_line_with_a_count() -> None:
    tally, named = FaultTally(), ("camera silent", "vision hangs")
    told = [tally.take(f"H9 FAULT {named[turn % 2]}", 10.0 * turn) for turn in range(8)]
    assert told[0] == ("H9", "H9 FAULT camera silent", True)
    assert told[1] == ("H9", "H9 FAULT camera silent, vision hangs: 2 times in 10 s", True)
    assert told[-1] == ("H9", "H9 FAULT camera silent, vision hangs: 8 times in 70 s", False)


def test_a_fault_that_stays_came_once_however_often_its_text_is_repeated() -> None:
    tally = FaultTally()
    told = [tally.take("H9 FAULT camera silent", float(second)) for second in range(5)]
    assert told == [("H9", "H9 FAULT camera silent", second == 0) for second in range(5)]


def test_a_name_with_other_figures_is_the_same_fault() -> None:
    tally = FaultTally()
    tally.take("H9 FAULT the frame is 1.4 s old", 0.0)
    text = "H9 FAULT the frame is 1.5 s old"
    assert tally.take(text, 1.0) == ("H9", text, False)


def test_of_too_many_faults_the_newest_is_told_and_the_oldest_left_out() -> None:
    tally, names = FaultTally(), [f"fault {letter}" for letter in "abcdefgh"[: MOST_NAMES + 1]]
    for name in names:
        told = tally.take(f"H9 FAULT {name}", 0.0)
    line = f"H9 FAULT {', '.join(names[1:])}: {len(names)} times in 0 s"
    assert told == ("H9", line, True)


def test_another_hold_counts_anew_and_other_texts_are_none() -> None:
    tally = FaultTally()
    tally.take("H9 FAULT camera silent", 0.0)
    tally.take("H9 FAULT vision hangs", 1.0)
    assert tally.take("H10 FAULT vision hangs", 2.0) == ("H10", "H10 FAULT vision hangs", True)
    tally.forget("H9")
    assert tally.take("H9 FAULT vision hangs", 3.0) == ("H9", "H9 FAULT vision hangs", True)
    assert tally.take("H9 holding", 4.0) is None


@given(st.lists(st.tuples(st.integers(0, 99), st.text(min_size=1, max_size=30)), max_size=200))
def test_what_it_keeps_is_bounded_whatever_is_said(said: list[tuple[int, str]]) -> None:
    tally = FaultTally()
    for at, (number, name) in enumerate(said):
        tally.take(f"H{number} FAULT {name}", float(at))
    kept = tally._by_subject
    assert len(kept) <= MOST_SUBJECTS
    assert all(len(told.names) <= MOST_NAMES for told in kept.values())
