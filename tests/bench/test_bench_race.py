"""Contestants in processes of their own, turn by turn."""

from __future__ import annotations

from pathlib import Path

import pytest

from bench.clipseg.contestants import ContestantPlan, Request
from bench.clipseg.measuring import ContestantError, Running, measure

PRETENDER = """
import os, time
from bench.clipseg.contestants import StepFigures
from bench.clipseg.parts import Parts

class Pretender:
    def __init__(self, diary, name, fails=""):
        if fails == "making":
            raise OSError("no such bundle")
        self.parts, self.diary, self.name, self.fails = Parts(), diary, name, fails

    def set_prompts(self, words, weights):
        self.count = len(words)

    def figures(self, frame):
        if self.fails == "death":
            os._exit(3)
        if self.fails == "silence":
            time.sleep(60)
        with open(self.diary, "a") as diary:
            diary.write(f"{self.name} {frame.shape[1]} {self.count}\\n")
        with self.parts.time("all"):
            pass
        return StepFigures(0.0, float(frame.mean()), (1.0,))
"""
SMALL = (32, 24)


@pytest.fixture
def diary(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    (tmp_path / "pretender.py").write_text(PRETENDER)
    monkeypatch.syspath_prepend(str(tmp_path))
    return tmp_path / "diary"


def plan(diary: Path, name: str, fails: str = "") -> ContestantPlan:
    return ContestantPlan(name, "pretender:Pretender", {"diary": str(diary), "name": name, "fails": fails})


def test_they_take_turns_on_the_same_frames_after_one_that_does_not_count(diary: Path) -> None:
    plans = [plan(diary, "a"), plan(diary, "b")]
    samples, failed = measure(plans, [(SMALL, 1), (SMALL, 4)], 2, lambda _: None)
    assert failed == {}
    turns = diary.read_text().split("\n")
    assert turns[:6] == ["a 32 1", "b 32 1", "b 32 1", "a 32 1", "a 32 1", "b 32 1"]
    assert turns[6].endswith("32 4")
    assert set(samples) == {(name, SMALL, count) for name in ("a", "b") for count in (1, 4)}
    means = [[sample.figures.roi_uncertainty for sample in samples[(name, SMALL, 1)]] for name in ("a", "b")]
    assert means[0] == means[1]
    assert means[0][0] != means[0][1]
    assert all(set(sample.parts) == {"all"} and sample.peak_mb > 1.0 for sample in samples[("a", SMALL, 1)])


def test_one_that_fails_or_dies_is_left_out_with_the_reason(diary: Path) -> None:
    plans = [plan(diary, "a"), plan(diary, "b", "making"), plan(diary, "c", "death")]
    said: list[str] = []
    samples, failed = measure(plans, [(SMALL, 1)], 1, said.append)
    assert {name for name, _, _ in samples} == {"a"}
    assert failed["b"] == "b: OSError: no such bundle"
    assert "c died" in failed["c"]
    assert any("no such bundle" in text for text in said)


def test_without_the_first_there_is_nothing_to_compare(diary: Path) -> None:
    with pytest.raises(ContestantError, match="no such bundle"):
        measure([plan(diary, "a", "making"), plan(diary, "b")], [(SMALL, 1)], 1, lambda _: None)


def test_one_that_says_nothing_is_not_waited_for_beyond_the_deadline(
    diary: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("bench.clipseg.measuring.LEAVING", 0.1)
    with Running(plan(diary, "a", "silence")) as running:
        running.wait_ready()
        with pytest.raises(ContestantError, match=r"a has not answered for 0\.2 s"):
            running.step(Request(SMALL, 1, 1), deadline=0.2)
    assert not running.alive
