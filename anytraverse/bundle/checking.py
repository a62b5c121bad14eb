"""Checks a bundle on this machine: verifies it, times it, and compares its int8 variant with fp32."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from datetime import datetime, timezone
from itertools import islice
from pathlib import Path
from statistics import median

import numpy as np

from anytraverse.bundle.calibrating import Calibrated, calibrate
from anytraverse.bundle.comparing import Array, BundleComparison, TimedOutputs
from anytraverse.bundle.machine import Machine, this_machine
from anytraverse.bundle.manifest import Manifest, manifest_digest, read_manifest, verify
from anytraverse.bundle.pictures import frames_of
from anytraverse.bundle.records import (
    CheckRecord,
    CheckRuntime,
    check_writable,
    choose_precision,
    save_record,
)
from anytraverse.bundle.timing import Timing, measured, peak_memory, time_parts
from anytraverse.errors import PerceiverError
from anytraverse.frame import Image
from anytraverse.perception import Perceiver, Prompt, make_perceiver
from anytraverse.perception.dense.perceiver import KIND as DENSE
from anytraverse.perception.dense.perceiver import Dense, not_calibrated
from anytraverse.perception.runtime import Runtime

WORDS = ("grass", "dirt path", "rock", "bush", "tree", "sky", "gravel", "water")
"""The words to look for unless the caller gives others."""
MOST_WORDS = 16

Say = Callable[[str], None]


@dataclass(frozen=True)
class BundleCheckPlan:
    """Holds what to check: `frames` is a folder of pictures or a video, `words` empty for `WORDS`.

    precision: the variant that is loaded first, and whose memory is reported. repeat: how often parts are
    timed. threads: cores; 0: all.
    """

    folder: Path
    frames: Path | None = None
    words: tuple[str, ...] = ()
    threads: int = 0
    precision: str = "fp32"
    repeat: int = 5


@dataclass
class BundleReport:
    """Holds the results of a check.

    memory: the peak with the first variant alone, MB. loads: precision -> seconds to load it. timings:
    precision -> its timing. calibrated: what was written into a dense bundle's manifest, if it was. record:
    of this check, if it made one. variant, why: the variant that runs here from now on, and the reason.
    refused: why the bundle does not run before another check, or empty.
    """

    manifest: Manifest
    machine: Machine
    threads: int
    memory: float = 0.0
    loads: dict[str, float] = field(default_factory=dict)
    timings: dict[str, Timing] = field(default_factory=dict)
    calibrated: Calibrated | None = None
    record: CheckRecord | None = None
    variant: str = ""
    why: str = ""
    refused: str = ""

    @property
    def timing(self) -> Timing:
        """The timing of the variant that will run, or else of one that was tried."""
        return self.timings.get(self.variant) or next(iter(self.timings.values()))


def check(plan: BundleCheckPlan, say: Say) -> BundleReport:
    """Verify, load and time the bundle. With frames, calibrate a dense one, compare variants, store a record.

    say: receives lines about the progress. Raises BundleError and PerceiverError when the bundle is refused
    or its fp32 variant fails; a failure of int8 is in the record.
    """
    manifest = read_manifest(plan.folder)
    manifest.parts(plan.precision)  # raises for a missing variant, before minutes of work
    runtime = Runtime(threads=plan.threads)
    report = BundleReport(manifest, this_machine(), runtime.cores)
    if plan.frames is not None:
        next(frames_of(plan.frames, _silent))  # raises when no picture can be read
        if "int8" in manifest.variants or manifest.kind == DENSE:
            check_writable(plan.folder)
    verify(plan.folder, manifest, say)
    perceivers = {plan.precision: _load_and_time(plan, plan.precision, report, say)}
    report.memory = peak_memory()
    if plan.frames is not None and manifest.kind == DENSE:
        _calibrate(plan, perceivers, report, say)
        manifest = report.manifest
    if plan.frames is not None and "int8" in manifest.variants:
        report.record = _check_int8(plan, perceivers, report, say)
        say(f"record: {save_record(plan.folder, report.record)}")
    report.variant, report.why = choose_precision(plan.folder, manifest, runtime)
    loaded = perceivers[plan.precision]
    if report.calibrated is None and isinstance(loaded, Dense) and loaded.details.calibration is None:
        report.refused = not_calibrated(plan.folder)
    return report


def _load_and_time(plan: BundleCheckPlan, precision: str, report: BundleReport, say: Say) -> Perceiver:
    """Load a variant and time it."""
    say(f"loading {precision}")
    begin = time.perf_counter()
    runtime = CheckRuntime(threads=plan.threads, precision=precision)
    perceiver = make_perceiver(f"{report.manifest.kind}:{plan.folder}", runtime)
    report.loads[precision] = time.perf_counter() - begin
    say(f"timing {precision}, {plan.repeat} times")
    report_skipped = _silent if "int8" in report.manifest.variants else say
    images = (
        [_noise()]
        if plan.frames is None
        else list(islice(frames_of(plan.frames, report_skipped), plan.repeat))
    )
    report.timings[precision] = time_parts(perceiver, images, words_of(plan, perceiver), plan.repeat)
    return perceiver


def _fp32(
    plan: BundleCheckPlan, perceivers: dict[str, Perceiver], report: BundleReport, say: Say
) -> Perceiver:
    """Return the fp32 variant; it is loaded and timed where it was not."""
    if "fp32" not in perceivers:
        perceivers["fp32"] = _load_and_time(plan, "fp32", report, say)
    return perceivers["fp32"]


def _calibrate(
    plan: BundleCheckPlan, perceivers: dict[str, Perceiver], report: BundleReport, say: Say
) -> None:
    """Calibrate by fp32; what is loaded already uses the new calibration, too."""
    fp32 = _fp32(plan, perceivers, report, say)
    assert isinstance(fp32, Dense)
    assert plan.frames is not None
    say("calibrating")
    report.calibrated = calibrate(plan.folder, fp32, frames_of(plan.frames, say), words_of(plan, fp32), say)
    report.manifest = read_manifest(plan.folder)
    for perceiver in perceivers.values():
        assert isinstance(perceiver, Dense)
        perceiver.calibration = report.calibrated.calibration


def _check_int8(
    plan: BundleCheckPlan, perceivers: dict[str, Perceiver], report: BundleReport, say: Say
) -> CheckRecord:
    fp32 = _fp32(plan, perceivers, report, say)
    words = words_of(plan, fp32)
    comparison, slow, fast = BundleComparison(words), report.timings["fp32"].step, 0.0
    try:
        int8 = perceivers.get("int8") or _load_and_time(plan, "int8", report, say)
    except PerceiverError as error:
        comparison.failure = str(error)
    else:
        assert plan.frames is not None
        slow, fast = compare(comparison, fp32, int8, frames_of(plan.frames, say), say)
    gain = slow / fast if fast else 0.0
    passed, why = comparison.verdict(gain)
    return CheckRecord(
        machine=report.machine,
        manifest=manifest_digest(plan.folder),
        when=datetime.now(timezone.utc).isoformat(timespec="seconds"),
        provider="CPU",
        threads=report.threads,
        frames=comparison.frames,
        words=tuple(words),
        masks=comparison.masks,
        iou=comparison.worst_word[1] if comparison.worst_word else None,
        iou_worst=comparison.iou_worst,
        iou_mean=comparison.iou_mean,
        stray=comparison.stray,
        cosine=comparison.cosine,
        fp32_ms=slow,
        int8_ms=fast,
        gain=gain,
        passed=passed,
        why=" ".join(why.split())[:400],
    )


def compare(
    comparison: BundleComparison, reference: Perceiver, other: Perceiver, frames: Iterable[Image], say: Say
) -> tuple[float, float]:
    """Run both on every frame and return their median milliseconds.

    They take turns at being first, so that a hot chip or a busy moment affects both alike. An error of the
    second is in the comparison's `failure`, and ends it.
    """
    prompts = [Prompt(word) for word in comparison.words]
    slow, fast = [], []
    for number, image in enumerate(frames):
        first = _run_step(reference, image, prompts) if number % 2 == 0 else None
        try:
            second = _run_step(other, image, prompts)
        except PerceiverError as error:
            comparison.failure = str(error)
            break
        first = first or _run_step(reference, image, prompts)
        comparison.add(first, second)
        slow.append(first.milliseconds)
        fast.append(second.milliseconds)
        if comparison.failure:
            break
        if number % 10 == 9:
            say(f"{number + 1} frames compared, {comparison.masks} masks")
    return (median(slow), median(fast)) if slow else (0.0, 0.0)


def _run_step(perceiver: Perceiver, image: Image, prompts: Sequence[Prompt]) -> TimedOutputs:
    def step() -> tuple[Array, Array]:
        features = perceiver.encode(image)
        return perceiver.attend(features, prompts), perceiver.embed(features)

    (maps, embedding), milliseconds, _ = measured(step)
    return TimedOutputs(maps, embedding, milliseconds)


def words_of(plan: BundleCheckPlan, perceiver: Perceiver) -> list[str]:
    """Return the words to look for; where the caller gives none, words that the perceiver knows."""
    if plan.words:
        for word in plan.words:
            perceiver.meaning(word)
        return list(plan.words[:MOST_WORDS])
    known = perceiver.vocabulary
    if known is None:
        return list(WORDS)
    return [word for word in WORDS if word in known] or list(known[: len(WORDS)])


def _noise() -> Image:
    return np.random.default_rng(0).integers(0, 256, (480, 640, 3), dtype=np.uint8)


def _silent(_: str) -> None:
    """Drop a line: the comparison, which reads all frames, will report the same."""
