"""The last line of CLIPSeg's benchmark, and its tables."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from bench.clipseg.frames import SIZES
from bench.clipseg.lineup import BUNDLES, CONTESTANTS, OURS, REFERENCE
from bench.clipseg.report import write_report
from bench.clipseg.results import Results, figures
from bench.commit import commit_of
from bench.machine import describe_run

if TYPE_CHECKING:
    from tests.bench.conftest import MakeSample, MakeSamples

ALL = {REFERENCE: [3.0, 6.0, 3.0], **{name: [1.0, 2.0, 1.5] for name in OURS}}
WORK = {name: {"tower": 1e9, "scene": 1e8} for name in ALL}


def test_the_last_line_quotes_every_ratio_and_memory(samples_of: MakeSamples) -> None:
    line = figures(Results(samples_of(ALL)))
    for size in ("", "_1280x720"):
        for name in OURS:
            assert [line[f"ratio_{name}_k{count}{size}"] for count in (1, 4, 8)] == [3.0, 3.0, 3.0]
        for name in ALL:
            assert line[f"rss_mb_{name}{size}"] == 100
    assert not [key for key in line if key.endswith("_reason")]
    assert json.loads(json.dumps(line)) == line


def test_a_precision_that_did_not_run_is_null_with_its_reason(samples_of: MakeSamples) -> None:
    ran = {name: seconds for name, seconds in ALL.items() if name != "int8"}
    results = Results(samples_of(ran), {"int8": "int8: no such kernel"})
    line = figures(results)
    assert line["ratio_int8_k4"] is None
    assert line["rss_mb_int8"] is None
    assert line["int8_reason"] == "int8: no such kernel"
    assert line["ratio_fp32_k4"] == 3.0
    assert "Not measured: int8: int8: no such kernel" in write_report(results, {"cpu": "some"}, WORK)


def test_maps_alone_leave_out_the_second_encoder_there_and_the_tail_here(sample: MakeSample) -> None:
    size = SIZES[0]
    results = Results(
        {
            (REFERENCE, size, 4): [sample(10.0, scene=4.0, tower=5.0)],
            ("fp32", size, 4): [sample(5.0, tail=3.0, tower=2.0)],
        }
    )
    found = results.times_faster_without_embedding("fp32", size, 4)
    assert found is not None
    assert found.median == 3.0


def test_peak_memory_is_quoted_by_frame_size_and_is_the_highest(sample: MakeSample) -> None:
    results = Results(
        {
            (REFERENCE, SIZES[0], 1): [sample(peak=10.0)],
            (REFERENCE, SIZES[0], 8): [sample(peak=20.0)],
            (REFERENCE, SIZES[1], 1): [sample(peak=30.0)],
        }
    )
    assert results.peak_mb(REFERENCE, SIZES[0]) == 20.0
    assert results.peak_mb(REFERENCE, SIZES[1]) == 30.0


def test_agreement_is_judged_by_the_worst_frame(sample: MakeSample) -> None:
    size = SIZES[0]
    results = Results(
        {
            (REFERENCE, size, 1): [sample(), sample()],
            ("fp32", size, 1): [sample(), sample(uncertainty=0.53)],
        }
    )
    assert results.roi_difference("fp32") == pytest.approx(0.03)


def test_the_report_shows_every_contestant_and_its_rate(samples_of: MakeSamples) -> None:
    text = write_report(Results(samples_of(ALL)), {"cpu": "some", "cpu_flags": ["avx2", "fma"]}, WORK)
    assert "cpu some, cpu_flags avx2 fma" in text
    for name in ALL:
        assert text.count(f"| {CONTESTANTS[name].label} |") >= 6 + 2 + 1
    assert "| fp32, shared scene | tower | 750.0 | 50.0% | 1.00 | 1 |" in text


def test_a_size_is_compared_with_352_and_a_dense_model_with_no_other(sample: MakeSample) -> None:
    size = SIZES[0]
    results = Results(
        {
            (REFERENCE, size, 4): [sample(uncertainty=0.9)],
            ("fp32", size, 4): [sample(uncertainty=0.5)],
            ("fp32_288", size, 4): [sample(uncertainty=0.52)],
            ("int8_288", size, 4): [sample(uncertainty=0.52)],
            ("fp32_siglip2", size, 4): [sample(uncertainty=0.7)],
        }
    )
    line = figures(results)
    assert line["roi_difference_fp32_288"] == pytest.approx(0.02)
    assert "roi_difference_int8_288" not in line  # int8 at 352 was not measured
    assert "roi_difference_fp32_siglip2" not in line
    text = write_report(results, {}, {name: {} for name in CONTESTANTS})
    assert "| fp32, shared scene, 288 | fp32, shared scene | 0.02000 | another embedding |" in text


def test_every_contestant_has_a_bundle_a_label_of_its_own_and_one_to_be_compared_with() -> None:
    assert len({entry.label for entry in CONTESTANTS.values()}) == len(CONTESTANTS)
    assert all(CONTESTANTS[name].bundle in BUNDLES for name in OURS)
    assert {entry.like for entry in CONTESTANTS.values()} <= {"", *CONTESTANTS}
    alike = {name for name, entry in CONTESTANTS.items() if entry.same_encoder}
    assert alike == {"fp32_clip_b32", "int8_clip_b32"}


def test_the_head_names_commit_and_date(samples_of: MakeSamples) -> None:
    machine = describe_run()
    assert machine["commit"]
    assert re.fullmatch(r"20\d\d-\d\d-\d\dT\d\d:\d\d:\d\d\+00:00", machine["when"])
    head = write_report(Results(samples_of(ALL)), machine, WORK).splitlines()[2]
    assert f"commit {machine['commit']}, when {machine['when']}, load " in head


def test_outside_git_there_is_no_commit(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert commit_of(tmp_path) == ""
    monkeypatch.setenv("PATH", str(tmp_path))
    assert commit_of(tmp_path) == ""


def test_the_last_line_has_a_plot_of_every_size_with_every_contestant(samples_of: MakeSamples) -> None:
    plots = figures(Results(samples_of(ALL)))["series"]
    assert len(plots) == len(SIZES)
    for one in plots:
        assert one["lines"].keys() == {CONTESTANTS[name].label for name in ALL}
        assert one["lines"]["fp32, shared scene"] == [[count, 1500, 1250, 1750] for count in (1, 4, 8)]
