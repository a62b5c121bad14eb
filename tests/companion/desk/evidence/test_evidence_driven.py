"""What the samples of recordings tell of the camera, of calls and of holds."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.desk.evidence.calls import call_times, calls_part
from companion.desk.evidence.camera import camera_losses
from companion.desk.evidence.drives import AnswerSample, CameraSample, DecisionSample, DrivenFacts
from tests.companion.desk.evidence.told import NOON, figures, sources


@given(
    st.lists(st.tuples(st.floats(3, 30), st.floats(0.3, 20)), max_size=5),
    st.floats(0, 0.99),
    st.floats(0.8, 1.2),
    st.booleans(),
)
def test_the_bounds_of_a_loss_contain_its_length(
    spans: list[tuple[float, float]], phase: float, period: float, restarted: bool
) -> None:
    """spans: seconds with ten pictures a second and without any, in turn. restarted: counts begin anew."""
    pictures, gaps, at = list[float](), list[tuple[float, float]](), 0.0
    for here, gone in spans:
        pictures += [at + number / 10 for number in range(int(here * 10))]
        begin, at = pictures[-1], at + here + gone
        gaps.append((begin, at))
    pictures += [at + number / 10 for number in range(30)]
    times = [phase + number * period for number in range(int((at + 3 - phase) / period))]
    samples = []
    for one in times:
        count = sum(picture <= one for picture in pictures)
        before = [sum(picture <= begin for picture in pictures) for begin, over in gaps if over <= one]
        samples.append(CameraSample(one, 7, count - (before[-1] if restarted and before else 0)))
    found = camera_losses(samples, 1.0)
    for loss in found:
        (gap,) = [gap for gap in gaps if gap[0] <= loss.at < gap[1]]
        assert loss.most is not None
        assert loss.least - 1e-6 <= gap[1] - gap[0] <= loss.most + 1e-6
        assert loss.most - loss.least <= 2.0 * period + 1e-6
    assert len(found) >= sum(over - begin > 1.0 + 2.0 * period and begin > times[1] for begin, over in gaps)


def test_a_loss_that_a_restart_cuts_off_has_no_end() -> None:
    samples = [
        CameraSample(float(at), pid, read, trouble=trouble)
        for at, pid, read, trouble in (
            *((1, 7, 10, False), (2, 7, 20, False), (3, 7, 20, False), (4, 7, 20, True), (5, 8, 0, False)),
            *((6, 8, 10, False), (7, 8, 10, False), (8, 8, 10, False), (60, 8, 99, False)),
        )
    ]
    assert camera_losses(samples, 1.5) == [(2.0, 2.0, None, True), (6.0, 2.0, None, False)]
    assert camera_losses(samples, 2.5) == []
    assert camera_losses([], 1.0) == []


def decided(at: float, what: str, number: int = 0, event: str = "") -> DecisionSample:
    return DecisionSample(NOON + at, what, number, event)


def test_operators_seconds_are_those_to_the_first_answer_that_counts(tmp_path: Path) -> None:
    driven = DrivenFacts(files=3, begin=NOON, end=NOON + 100, metres=500.0)
    driven.decisions += [
        decided(0, "call opened", 7),
        decided(20, "call closed", 7),
        decided(30, "call opened", 8),
        decided(40, "call closed", 8),
    ]
    driven.answers += [
        AnswerSample(NOON + 2, 7, "refused"),
        AnswerSample(NOON + 5, 7, "not_covered"),
        AnswerSample(NOON + 9, 7, "applied"),
        AnswerSample(NOON + 41, 8, "applied"),
    ]
    assert [one.first for one in call_times(driven)] == [5.0, None]
    told = figures(calls_part(sources(tmp_path, driven=driven)).document())
    assert told["calls per km"] == 4.0
    assert told["operator's seconds per km, of answered calls"] == 10.0
    assert told["calls answered"] == 1
    part = calls_part(sources(tmp_path, driven=replace(driven, lacking=2)))
    assert not [name for name in figures(part.document()) if "per km" in name], (
        "those without a call were deleted first"
    )
    assert "calls per kilometre" in [one.what for one in part.unknown]


def test_a_call_answered_after_the_clock_was_set_has_no_time() -> None:
    driven = DrivenFacts(files=1, decisions=[DecisionSample(100.0, "call opened", 1)])
    driven.answers.append(AnswerSample(NOON, 1, "applied"))
    assert call_times(driven) == [(True, None)]


def test_a_takeover_and_a_mode_of_ours_after_it_are_told(tmp_path: Path) -> None:
    driven = DrivenFacts(files=1, begin=NOON, end=NOON + 100)
    driven.decisions += [
        decided(0, "set mode", 7),
        decided(0, "hold started", 7),
        decided(0.4, "hold moved", 7, event="confirmed"),
        decided(5, "hold moved", 7, event="taken_over"),
        decided(6, "set mode", 8),
        decided(30, "hold moved", 8, event="taken_over"),
    ]
    told = figures(calls_part(sources(tmp_path, driven=driven)).document())
    assert told["holds that a human's mode ended"] == 2
    assert told["of these, a mode of ours within 2 s"] == 1
    assert told["from order to hold until the autopilot shows it, longest"] == pytest.approx(0.4)
