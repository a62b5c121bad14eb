"""Writes the measured figures as tables in Markdown."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from bench.clipseg.frames import COUNTS, SIZES
from bench.clipseg.lineup import BUNDLES, CONTESTANTS, OURS, REFERENCE
from bench.clipseg.results import Results
from bench.clipseg.work import ClipSegWork, Transformer, dense_image, dense_scores, read_clip, read_clipseg
from bench.ratios import spread

SHOWN = (SIZES[0], 4)
"""The case whose parts are shown."""
_SHOWN_FROM = 5e-5
"""Seconds. A part that takes less comes from a cache, like the prompts' embeddings, and is not shown."""

EXPLANATION = (
    "CPU: process CPU time of one step at one thread, median [quartiles]; faster: the authors' CPU time over "
    "this one's, by pairs of the same round. Both embed the scene on every frame. Random weights cost what "
    "trained ones do, and say nothing of accuracy. The authors' step makes maps at the frame's size; this "
    "project's pools at the network's own size and enlarges a map only where somebody looks at it."
)
LIKENESS = (
    'Like meets like: a row of a "CLIP B/32 scene" runs the same second encoder as the authors\' step. '
    '"Maps alone" leaves out, on both sides, what makes the scene\'s embedding: the second encoder, or the '
    'tail of the tower. For another size or another model, "faster" is a statement of time alone: its maps '
    "are coarser, or others."
)
AGREEMENT = (
    "A size is compared with 352 in the same precision, int8 of a dense model with its fp32. The weights are "
    "random and their maps not calibrated: what a size or int8 loses with real weights, `anytraverse bundle "
    "check` measures on real frames."
)


def write_report(
    results: Results, machine: Mapping[str, Any], work: Mapping[str, Mapping[str, float]]
) -> str:
    """Returns the whole report. work: contestant -> part -> floating-point operations in the case shown."""
    return "\n\n".join(
        [
            "# Bundles of this project against the authors' AnyTraverse 2.0.0",
            ", ".join(f"{key} {_plain(value)}" for key, value in machine.items()),
            EXPLANATION,
            _table(["frame", "prompts", "who", "CPU ms", "wall ms", "faster", "maps alone"], _steps(results)),
            LIKENESS,
            f"## Parts at {SHOWN[0][0]}x{SHOWN[0][1]}, {SHOWN[1]} prompts",
            _table(["who", "part", "CPU ms", "share", "GFLOP", "GFLOP/s"], _parts(results, work)),
            "## Peak resident memory, MB",
            _table(["who", *(f"{w}x{h}" for w, h in results.sizes), "share"], _memory(results)),
            "## Agreement",
            AGREEMENT,
            _table(
                [
                    "who",
                    "compared with",
                    "largest difference of a ROI mean",
                    "cosine with the authors' scene",
                ],
                _agreement(results),
            ),
            *[f"Not measured: {name}: {why}" for name, why in results.missing.items()],
        ]
    )


def count_work(models: Path, count: int, tiny: bool = False) -> dict[str, dict[str, float]]:
    """Computes the floating-point operations of each contestant's parts with `count` prompts.

    models: the folder with the checkpoints `clipseg` and `clip`.
    """
    clipseg, scene = models / "clipseg", read_clip(models / "clip")
    net = read_clipseg(clipseg)
    work = {
        REFERENCE: {
            "scene": scene.tower(scene.layers) + scene.tail(scene.layers),
            "tower": net.tower_whole(),
            "decoder": count * (net.reduce() + net.decoder()),
        }
    }
    for name in OURS:
        made = BUNDLES[CONTESTANTS[name].bundle]
        size = made.tiny if tiny else made.size
        if made.model != "clipseg":
            work[name] = {
                "tower": dense_image(made.model, size, tiny),
                "scores": count * dense_scores(made.model, size, tiny),
            }
            continue
        net = read_clipseg(clipseg, size)
        work[name] = _ours(net, count) | (
            {"tail": net.tail()} if made.scene == "shared" else {"scene": _once(scene)}
        )
    return work


def _ours(net: ClipSegWork, count: int) -> dict[str, float]:
    return {"tower": net.tower_needed() + net.reduce(), "decoder": count * net.decoder()}


def _once(scene: Transformer) -> float:
    """Counts an embedding whose last layer is computed for the class token alone."""
    return scene.tower(scene.layers - 1) + scene.tail(scene.layers - 1)


def _steps(results: Results) -> Iterable[Sequence[str]]:
    for size in results.sizes:
        for count in COUNTS:
            for name in results.names:
                samples = results.of(name, size, count)
                if not samples:
                    continue
                faster = results.times_faster(name, size, count)
                alone = results.times_faster_without_embedding(name, size, count)
                yield [
                    f"{size[0]}x{size[1]}",
                    str(count),
                    CONTESTANTS[name].label,
                    f"{spread([sample.cpu for sample in samples]).times(1e3):.0f}",
                    f"{spread([sample.wall for sample in samples]).median * 1e3:.0f}",
                    f"{faster:.2f}" if name != REFERENCE else "",
                    f"{alone.median:.2f}" if alone and name != REFERENCE else "",
                ]


def _parts(results: Results, work: Mapping[str, Mapping[str, float]]) -> Iterable[Sequence[str]]:
    for name in results.names:
        samples = results.of(name, *SHOWN)
        whole = spread([sample.cpu for sample in samples]).median
        for part in dict.fromkeys(part for sample in samples for part in sample.parts):
            seconds = results.part(name, part, *SHOWN).median
            if seconds < _SHOWN_FROM:
                continue
            operations = work[name].get(part)
            yield [
                CONTESTANTS[name].label,
                part,
                f"{seconds * 1e3:.1f}",
                f"{seconds / whole:.1%}",
                f"{operations / 1e9:.2f}" if operations else "",
                f"{operations / 1e9 / seconds:.0f}" if operations and seconds > 0 else "",
            ]


def _memory(results: Results) -> Iterable[Sequence[str]]:
    reference = results.peak_mb(REFERENCE, results.sizes[0])
    for name in results.names:
        peaks = [results.peak_mb(name, size) for size in results.sizes]
        share = f"{peaks[0] / reference:.0%}" if peaks[0] and reference else ""
        yield [CONTESTANTS[name].label, *(f"{peak:.0f}" if peak else "" for peak in peaks), share]


def _agreement(results: Results) -> Iterable[Sequence[str]]:
    for name in results.names:
        difference, cosine = results.roi_difference(name), results.embedding_cosine(name)
        if difference is not None:
            yield [
                CONTESTANTS[name].label,
                CONTESTANTS[CONTESTANTS[name].like].label,
                f"{difference:.5f}",
                "another embedding" if cosine is None else f"{cosine:.6f}",
            ]


def _table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    lines = [head, ["---"] * len(head), *rows]
    return "\n".join(f"| {' | '.join(line)} |" for line in lines)


def _plain(value: object) -> str:
    return " ".join(map(str, value)) if isinstance(value, list) else str(value)
