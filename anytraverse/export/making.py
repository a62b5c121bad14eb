"""Makes a bundle from the weights of a CLIPSeg. Needs numpy and onnx, not torch."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from anytraverse.bundle.manifest import Manifest
from anytraverse.bundle.writing import BundleWriter
from anytraverse.errors import BundleError
from anytraverse.export.architecture import Architecture, Vision, Weights
from anytraverse.export.clipseg_graphs import image_graph, scene_graph, tail_graph, text_graphs
from anytraverse.export.decoder_graph import decoder_graph
from anytraverse.export.graph import Graph
from anytraverse.export.linear import LINEAR, stored_int8
from anytraverse.export.smoothing import smoothed
from anytraverse.perception import DefaultThresholds
from anytraverse.perception.resizing import Fit
from anytraverse.perception.tokenizer import Tokenizer

TOKEN_TABLE = "tokens.npy"
TOKENIZER = "tokenizer.json"
SCENE_THRESHOLDS = {"shared": 0.9, "clip-b32": 0.925}
"""Cosine below which the scene has changed. clip-b32: from the paper. shared: a first guess, to be tuned."""


@dataclass(frozen=True)
class ClipSegCheckpoint:
    """Holds all of a CLIPSeg that a bundle needs.

    filter: of the resize that it was trained with. tokenizer: its tokenizer.json, which cuts texts.
    source: where the weights come from, for the manifest.
    """

    architecture: Architecture
    weights: Weights
    filter: str
    tokenizer: str
    source: Mapping[str, str]


@dataclass(frozen=True)
class SceneCheckpoint:
    """Holds a separate image encoder for the scene embedding."""

    vision: Vision
    weights: Weights
    fit: Fit
    source: Mapping[str, str]


def make_bundle(
    out: Path,
    checkpoint: ClipSegCheckpoint,
    *,
    size: int,
    precisions: Sequence[str] = ("fp32",),
    scene: SceneCheckpoint | None = None,
    name: str = "clipseg",
    say: Callable[[str], None] = lambda _: None,
) -> Manifest:
    """Write the bundle `out` for pictures of size x size pixels.

    fp32 is always written. scene: None: the embedding comes from CLIPSeg's own image tower.
    Raises BundleError for a size, a precision or a checkpoint that cannot be used.
    """
    arch, weights = checkpoint.architecture, checkpoint.weights
    check_precisions(precisions)
    _check_architecture(arch, size)
    for each in (weights, scene.weights if scene is not None else {}):
        check_weights(each)
    variants: dict[str, dict[str, str]] = {}
    scene_kind = "shared" if scene is None else "clip-b32"
    with BundleWriter(out, say) as writer:
        for precision in dict.fromkeys(("fp32", *precisions)):
            variants[precision] = {}
            for part, graph in _graphs(checkpoint, scene, size, precision):
                say(f"writing {part}, {precision}")
                file = f"{part}.onnx" if precision == "fp32" else f"{part}.{precision}.onnx"
                graph.save(writer.folder / file)
                variants[precision][part] = file
        variants["fp32"] |= {"tokens": TOKEN_TABLE, "tokenizer": TOKENIZER}
        table = weights["clip.text_model.embeddings.token_embedding.weight"]
        np.save(writer.folder / TOKEN_TABLE, np.ascontiguousarray(table, dtype=np.float32))
        save_tokenizer(writer.folder / TOKENIZER, checkpoint.tokenizer, len(table))
        return writer.finish(
            kind="clipseg",
            name=name,
            model_id=f"{name}-{size}-{scene_kind}-{_digest(checkpoint, scene)}",
            image=Fit(size, size, checkpoint.filter),
            scene=scene_kind,
            scene_image=scene.fit if scene is not None else None,
            thresholds=DefaultThresholds(roi=0.3, scene=SCENE_THRESHOLDS[scene_kind]),
            variants=variants,
            details={"joint": arch.joint},
            source=_source(checkpoint, scene),
        )


def _graphs(
    checkpoint: ClipSegCheckpoint, scene: SceneCheckpoint | None, size: int, precision: str
) -> Iterator[tuple[str, Graph]]:
    """Yield the parts of a variant, one at a time, since each part holds a copy of its weights."""
    arch, weights, linear = checkpoint.architecture, checkpoint.weights, LINEAR[precision]
    if precision == "int8":
        weights = smoothed(weights, "clip.vision_model.encoder", arch.vision.tower.layers)
    yield "image", image_graph(arch, weights, size, linear)
    yield "tail", tail_graph(arch, weights, size, linear)
    yield "decoder", decoder_graph(arch, weights, size, linear)
    if scene is not None:
        encoder = scene.weights
        if precision == "int8":
            encoder = smoothed(encoder, "vision_model.encoder", scene.vision.tower.layers)
        products = linear if precision != "fp32" else stored_int8
        yield "scene", scene_graph(scene.vision, encoder, scene.fit.width, products)
    if precision == "fp32":  # the text tower runs only for a new word: int8 would gain little
        for number, piece in enumerate(text_graphs(arch, weights, linear), 1):
            yield f"text-{number}", piece


def check_precisions(precisions: Sequence[str]) -> None:
    """Raise BundleError for an unknown precision."""
    for precision in precisions:
        if precision not in LINEAR:
            raise BundleError(f'no precision is called "{precision}": choose from {", ".join(LINEAR)}')


def _check_architecture(arch: Architecture, size: int) -> None:
    patch = arch.vision.patch
    if size % patch or not 2 * patch <= size <= 1024:
        raise BundleError(
            f"size {size} does not fit: give a multiple of {patch} from {2 * patch} to 1024, e.g. 352"
        )
    layers, read = arch.vision.tower.layers, arch.decoder.extract
    if len(set(read)) < len(read) or not set(read) <= set(range(layers)):
        raise BundleError(f"the decoder reads layers {read} of an image tower of {layers}: no such CLIPSeg")
    if not 0 <= arch.decoder.conditional < len(read):
        raise BundleError(
            f"the prompt comes in at step {arch.decoder.conditional} of {len(read)}: no such CLIPSeg"
        )


def check_weights(weights: Weights) -> None:
    for name, array in weights.items():
        if array.dtype != np.float32:
            raise BundleError(f"the weights {name} are {array.dtype}: give them as float32")
        if not np.isfinite(array).all():
            raise BundleError(f"the checkpoint's {name} is not finite: download it again")


def save_tokenizer(path: Path, content: str, embedded: int) -> None:
    """Write a tokenizer.json. embedded: the tokens that the network knows. Raises BundleError."""
    try:
        size = Tokenizer(content.encode()).size()
    except ValueError as error:
        raise BundleError(f"the checkpoint's tokenizer cannot be used: {error}") from error
    if size > embedded:
        raise BundleError(
            f"the tokenizer knows {size} tokens, the network {embedded}: "
            "they do not belong together, copy the checkpoint again"
        )
    path.write_text(content, encoding="utf-8")


def _digest(checkpoint: ClipSegCheckpoint, scene: SceneCheckpoint | None) -> str:
    """Return eight hexadecimal digits that identify the weights and the architecture."""
    digest = hashlib.sha256(repr((checkpoint.architecture, checkpoint.filter)).encode())
    for weights in (checkpoint.weights, scene.weights if scene is not None else {}):
        for name in sorted(weights):
            digest.update(name.encode())
            digest.update(np.ascontiguousarray(weights[name]).data)
    return digest.hexdigest()[:8]


def _source(checkpoint: ClipSegCheckpoint, scene: SceneCheckpoint | None) -> dict[str, str]:
    described = dict(checkpoint.source)
    if scene is not None:
        described |= {f"scene_{key}": value for key, value in scene.source.items()}
    return described
