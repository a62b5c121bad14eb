"""How figures and tables are rounded and shown, whatever is in them."""

from __future__ import annotations

from pathlib import Path

from hypothesis import given
from hypothesis import strategies as st

from companion.desk.evidence.collect import evidence
from companion.desk.evidence.page import page
from companion.desk.evidence.parts import MOST_ROWS, Basis, EvidencePart, quantile, utc
from tests.companion.desk.evidence.told import sources


def test_all_that_is_shown_is_text(tmp_path: Path) -> None:
    evil = "<script>alert(1)</script>"
    part = EvidencePart(evil)
    part.tell(Basis(evil), (evil, evil, evil))
    part.tabulate(evil, [{evil: evil}])
    part.lack(evil, evil, evil)
    part.note = evil
    told = evidence(sources(tmp_path), "SHA256:<x>")
    unknown = [one._asdict() for one in part.unknown]
    shown = page({**told, "parts": {"x": part.document()}, "unknown": unknown}, evil)
    assert "<script" not in shown
    assert shown.count("&lt;script&gt;") == 15


def test_a_long_table_has_its_last_rows_and_counts_the_others() -> None:
    part = EvidencePart("x")
    part.tabulate("t", [{"n": number} for number in range(MOST_ROWS + 5)])
    (made,) = part.tables
    assert (len(made["rows"]), made["left_out"], made["rows"][-1]) == (MOST_ROWS, 5, {"n": MOST_ROWS + 4})


@given(st.lists(st.floats(0, 100), min_size=1), st.floats(0.01, 1))
def test_a_share_of_all_values_is_no_greater(values: list[float], least: float) -> None:
    found = quantile(values, least)
    assert sum(value <= found for value in values) >= least * len(values) - 1e-9


@given(st.floats(allow_nan=True))
def test_any_time_is_formatted_or_none(at: float) -> None:
    told = utc(at)
    assert told is None or told.endswith("Z")
