"""The last line of CLIPSeg's benchmark, and its tables."""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence

import pytest

from bench.clipseg.contestants import Sample, StepFigures
from bench.clipseg.frames import COUNTS, SIZES
from bench.clipseg.lineup import CONTESTANTS, OURS, REFERENCE
from bench.clipseg.measuring import Samples
from bench.clipseg.report import write_report
from bench.clipseg.results import Results, figures

ALL = {REFERENCE: [3.0, 6.0, 3.0], **{name: [1.0, 2.0, 1.5] for name in OURS}}
WORK = {name: {"tower": 1e9, "scene": 1e8} for name in ALL}


def sample(cpu: float = 1.0, peak: float = 100.0, uncertainty: float = 0.5, **parts: float) -> Sample:
    """A sample of so many CPU seconds, so that the figures quoted from it can be worked out by hand."""
    return Sample(cpu, cpu, parts, StepFigures(0.25, uncertainty, (0.6, 0.8)), peak)


def samples_of(seconds: Mapping[str, Sequence[float]]) -> Samples:
    """The same CPU seconds for a contestant in every case; a tenth of each step is the scene's embedding."""
    return {
        (name, size, count): [sample(cpu, scene=cpu / 10, tower=cpu / 2) for cpu in rounds]
        for size in SIZES
        for count in COUNTS
        for name, rounds in seconds.items()
    }


def test_the_last_line_quotes_every_ratio_and_memory() -> None:
    line = figures(Results(samples_of(ALL)))
    for size in ("", "_1280x720"):
        for name in OURS:
            assert [line[f"ratio_{name}_k{count}{size}"] for count in (1, 4, 8)] == [3.0, 3.0, 3.0]
        for name in ALL:
            assert line[f"rss_mb_{name}{size}"] == 100
    assert not [key for key in line if key.endswith("_reason")]
    assert json.loads(json.dumps(line)) == line


def test_a_precision_that_did_not_run_is_null_with_its_reason() -> None:
    ran = {name: seconds for name, seconds in ALL.items() if name != "int8"}
    results = Results(samples_of(ran), {"int8": "int8: no such kernel"})
    line = figures(results)
    assert line["ratio_int8_k4"] is None
    assert line["rss_mb_int8"] is None
    assert line["int8_reason"] == "int8: no such kernel"
    assert line["ratio_fp32_k4"] == 3.0
    assert "Not measured: int8: int8: no such kernel" in write_report(results, {"cpu": "some"}, WORK)


def test_maps_alone_leave_out_the_second_encoder_there_and_the_tail_here() -> None:
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


def test_peak_memory_is_quoted_by_frame_size_and_is_the_highest() -> None:
    results = Results(
        {
            (REFERENCE, SIZES[0], 1): [sample(peak=10.0)],
            (REFERENCE, SIZES[0], 8): [sample(peak=20.0)],
            (REFERENCE, SIZES[1], 1): [sample(peak=30.0)],
        }
    )
    assert results.peak_mb(REFERENCE, SIZES[0]) == 20.0
    assert results.peak_mb(REFERENCE, SIZES[1]) == 30.0


def test_agreement_is_judged_by_the_worst_frame() -> None:
    size = SIZES[0]
    results = Results(
        {
            (REFERENCE, size, 1): [sample(), sample()],
            ("fp32", size, 1): [sample(), sample(uncertainty=0.53)],
        }
    )
    assert results.roi_difference("fp32") == pytest.approx(0.03)


def test_the_report_shows_every_contestant_and_its_rate() -> None:
    text = write_report(Results(samples_of(ALL)), {"cpu": "some", "cpu_flags": ["avx2", "fma"]}, WORK)
    assert "cpu some, cpu_flags avx2 fma" in text
    for name in ALL:
        assert text.count(f"| {CONTESTANTS[name].label} |") >= 6 + 2 + 1
    assert "| fp32, shared scene | tower | 750.0 | 50.0% | 1.00 | 1 |" in text


def test_a_size_is_compared_with_352_and_a_dense_model_with_no_other() -> None:
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
