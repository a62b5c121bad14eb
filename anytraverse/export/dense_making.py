"""Makes a bundle from the weights of a dense model. Needs numpy, onnx and onnxruntime, not torch."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from anytraverse.bundle.manifest import Manifest
from anytraverse.bundle.writing import BundleWriter
from anytraverse.errors import BundleError
from anytraverse.export.architecture import DenseArchitecture, Weights
from anytraverse.export.dense_graphs import VISION, image_graph, scores_graph, text_graphs
from anytraverse.export.graph import Graph
from anytraverse.export.linear import LINEAR
from anytraverse.export.making import TOKEN_TABLE, TOKENIZER, check_precisions, check_weights, save_tokenizer
from anytraverse.export.smoothing import smoothed
from anytraverse.perception import DefaultThresholds
from anytraverse.perception.dense.details import DenseDetails, as_json
from anytraverse.perception.dense.words import WordEmbeddings
from anytraverse.perception.resizing import Fit
from anytraverse.perception.runtime import Runtime
from anytraverse.perception.text_tower import TextTower

ABSENT_FILE, WORDS_FILE = "absent.npy", "words.npy"
TEMPLATES = ("a photo of {}.", "a photo of the {}.", "{} outdoors.", "{}")
WORDS = (
    *("grass", "tall grass", "meadow", "dirt", "dirt path", "path", "trail", "road", "gravel", "sand"),
    *("mud", "rock", "rocks", "stone", "boulder", "bush", "bushes", "shrub", "tree", "tree trunk"),
    *("forest", "log", "leaves", "water", "puddle", "stream", "snow", "ice", "sky", "asphalt"),
    *("person", "animal", "car", "fence", "wall", "building", "ditch", "hole", "barrel", "drum"),
)
"""Words whose embeddings every bundle has, so that they need no text tower on the rover."""
ABSENT = (
    *("piano", "refrigerator", "toothbrush", "wedding dress"),
    *("computer keyboard", "pizza", "violin", "bathtub"),
    *("microwave oven", "chandelier", "goldfish bowl", "sewing machine"),
    *("tennis racket", "birthday cake", "bookshelf", "hair dryer"),
    *("trumpet", "sofa", "ironing board", "chess board"),
    *("teapot", "pillow", "shower curtain", "vending machine"),
    *("roller coaster", "submarine", "escalator", "operating table"),
    *("billiard table", "lipstick", "wine glass", "telephone booth"),
    *("cash register", "carousel", "sushi", "hamburger"),
    *("alarm clock", "printer", "bunk bed", "swimming goggles"),
    *("necktie", "high heels", "candle holder", "washing machine"),
    *("toilet", "espresso machine", "television studio", "polar bear"),
)
"""Things that a rover's terrain hardly ever shows."""
THRESHOLDS = DefaultThresholds(roi=0.3, scene=0.9, tile=0.5)
"""First guesses: every model and every ground needs its own."""


@dataclass(frozen=True)
class DenseCheckpoint:
    """Holds all of a dense model that a bundle needs.

    tokens: the vectors of all tokens, (n, width). tokenizer: its tokenizer.json, which cuts and fills texts.
    size: pixels of the square input it was trained with. filter: of its resize.
    source: where the weights come from, for the manifest.
    """

    architecture: DenseArchitecture
    weights: Weights
    tokens: NDArray[np.float32]
    tokenizer: str
    size: int
    filter: str
    source: Mapping[str, str]


def make_dense_bundle(
    out: Path,
    checkpoint: DenseCheckpoint,
    *,
    size: int | None = None,
    precisions: Sequence[str] = ("fp32",),
    templates: Sequence[str] = TEMPLATES,
    absent: Sequence[str] = ABSENT,
    name: str = "dense",
    say: Callable[[str], None] = lambda _: None,
) -> Manifest:
    """Write the bundle `out` for pictures of size x size pixels, by default the checkpoint's own size.

    fp32 is always written. The bundle must still be calibrated, by a check with frames.
    Raises BundleError for a size, a precision, a template or a checkpoint that cannot be used.
    """
    arch, side = checkpoint.architecture, checkpoint.size if size is None else size
    check_precisions(precisions)
    _check_size(arch, side)
    for weights in (checkpoint.weights, {"token_embedding": checkpoint.tokens}):
        check_weights(weights)
    grid = side // arch.vision.patch
    details = DenseDetails(arch.family, grid, arch.joint, tuple(templates), WORDS, tuple(absent))
    variants: dict[str, dict[str, str]] = {}
    with BundleWriter(out, say) as writer:
        for precision in dict.fromkeys(("fp32", *precisions)):
            variants[precision] = {}
            for part, graph in _graphs(checkpoint, side, precision):
                say(f"writing {part}, {precision}")
                file = f"{part}.onnx" if precision == "fp32" else f"{part}.{precision}.onnx"
                graph.save(writer.folder / file)
                variants[precision][part] = file
        pieces = [file for part, file in variants["fp32"].items() if part.startswith("text-")]
        np.save(writer.folder / TOKEN_TABLE, np.ascontiguousarray(checkpoint.tokens))
        save_tokenizer(writer.folder / TOKENIZER, checkpoint.tokenizer, len(checkpoint.tokens))
        say(f"embedding {len(WORDS) + len(absent)} words")
        tower = TextTower([writer.folder / file for file in pieces], writer.folder / TOKEN_TABLE, Runtime())
        words = WordEmbeddings(tower, writer.folder / TOKENIZER, templates)
        for file, texts in ((ABSENT_FILE, absent), (WORDS_FILE, WORDS)):
            np.save(writer.folder / file, np.stack(words.embeddings(texts)))
        variants["fp32"] |= {"tokens": TOKEN_TABLE, "tokenizer": TOKENIZER}
        variants["fp32"] |= {"absent": ABSENT_FILE, "words": WORDS_FILE}
        return writer.finish(
            kind="dense",
            name=name,
            model_id=f"{name}-{side}-{_digest(checkpoint)}",
            image=Fit(side, side, checkpoint.filter),
            scene="own",
            thresholds=THRESHOLDS,
            variants=variants,
            details=as_json(details),
            source=checkpoint.source,
        )


def _graphs(checkpoint: DenseCheckpoint, size: int, precision: str) -> Iterator[tuple[str, Graph]]:
    """Yield the parts of a variant, one at a time, since each part holds a copy of its weights."""
    arch, weights = checkpoint.architecture, checkpoint.weights
    if precision == "int8":
        weights = smoothed(weights, f"{VISION}.encoder", arch.vision.tower.layers)
    yield "image", image_graph(arch, weights, size, LINEAR[precision])
    if precision == "fp32":
        yield "scores", scores_graph(arch, size)
        for number, piece in enumerate(text_graphs(arch, weights), 1):
            yield f"text-{number}", piece


def _check_size(arch: DenseArchitecture, size: int) -> None:
    patch = arch.vision.patch
    if size % patch or not 2 * patch <= size <= 1024:
        raise BundleError(f"size {size} does not fit: give a multiple of {patch} from {2 * patch} to 1024")


def _digest(checkpoint: DenseCheckpoint) -> str:
    """Return eight hexadecimal digits that identify the weights and the architecture."""
    digest = hashlib.sha256(repr((checkpoint.architecture, checkpoint.filter)).encode())
    for name in sorted(checkpoint.weights):
        digest.update(name.encode())
        digest.update(np.ascontiguousarray(checkpoint.weights[name]).data)
    return digest.hexdigest()[:8]
