"""Runs `anytraverse bundle classes`: makes a bundle of a segmentation network that the user trained."""

from __future__ import annotations

import argparse
import hashlib
import json
import re
import sys
from dataclasses import asdict
from pathlib import Path

from anytraverse.bundle.class_names import read_class_names
from anytraverse.bundle.manifest import Manifest, sha256_of
from anytraverse.bundle.network_files import copy_network
from anytraverse.bundle.network_form import NetworkForm, NetworkOptions, network_form
from anytraverse.bundle.writing import BundleWriter
from anytraverse.errors import AnyTraverseError, BundleError
from anytraverse.judging import Settings
from anytraverse.perception import DefaultThresholds
from anytraverse.perception.classes.details import ACTIVATIONS, LAYOUTS, InputForm, Triple, as_json
from anytraverse.perception.classes.perceiver import KIND, PART, WEIGHTS
from anytraverse.perception.resizing import FILTERS, Fit

IMAGENET_MEAN, IMAGENET_STD = (0.485, 0.456, 0.406), (0.229, 0.224, 0.225)
THRESHOLDS = DefaultThresholds(roi=0.3, scene=0.75, tile=0.5)
"""Defaults to begin with; every network needs its own."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    parser.description = (
        "Make a bundle of a semantic segmentation network in ONNX: its class names become the words. "
        "What the network says of itself need not be given."
    )
    add = parser.add_argument
    add(
        "model",
        metavar="MODEL.onnx",
        type=Path,
        help="the network; weights that stand beside it in MODEL.onnx.data come along",
    )
    add("out", metavar="OUT", type=Path, help="the folder to write")
    add(
        "--names",
        metavar="NAMES.txt",
        type=Path,
        required=True,
        help="one class a line, in the order of the network's outputs: its name, then synonyms after commas; "
        'a line that begins with "-" is a class that is not a word',
    )
    add("--size", metavar="WxH", type=_size, help="of the input, where the network leaves it free")
    add("--mean", metavar="R,G,B", type=_triple, help="of the training pictures, by default ImageNet's")
    add("--std", metavar="R,G,B", type=_triple, help="likewise")
    add("--scale", type=float, help="what pixels are multiplied by before that, by default 1/255")
    add("--bgr", action="store_true", help="the network was trained on BGR pictures")
    add(
        "--filter", choices=FILTERS, default="bilinear", help="how frames are resized, by default %(default)s"
    )
    add("--layout", choices=LAYOUTS, help="of the input, where its shape leaves it open")
    add("--activation", choices=ACTIVATIONS, help="what is left to be done to the scores")
    add("--output", metavar="NAME", help="the network's output with the scores, by default its first")
    add(
        "--thresholds",
        type=_thresholds,
        default=THRESHOLDS,
        metavar="LIST",
        help=f'that suit the network, by default "{_thresholds_text(THRESHOLDS)}"',
    )
    add("--name", help="of the bundle, for people, by default the file's")
    add("--source", default="", metavar="TEXT", help="where the weights come from, for the manifest")
    add("--licence", default="", metavar="TEXT", help="of the weights, likewise")


def run(options: argparse.Namespace) -> int:
    """Write the bundle and print a description of it. Returns 0. Raises BundleError, OSError."""
    words = read_class_names(options.names)
    wishes = NetworkOptions(_form(options), options.size, options.layout, options.activation, options.output)
    with BundleWriter(options.out, lambda line: print(line, file=sys.stderr)) as writer:
        files = copy_network(options.model, writer.folder)
        found = network_form(writer.folder / files[0], words, wishes)
        if found.details.form.dtype == "uint8" and _normalised(options):
            raise BundleError("the network takes bytes as they are: leave --mean, --std and --scale out")
        image = Fit(*found.size, options.filter)
        details = as_json(found.details)
        name = options.name or options.model.stem
        manifest = writer.finish(
            kind=KIND,
            name=name,
            model_id=_model_id(name, [sha256_of(writer.folder / file) for file in files], details, image),
            image=image,
            scene="own",
            thresholds=options.thresholds,
            variants={"fp32": dict(zip((PART, WEIGHTS), files, strict=False))},
            source={"weights": options.source or options.model.name, "licence": options.licence},
            details=details,
        )
    print(_text(options.out, manifest, found))
    return 0


def _form(options: argparse.Namespace) -> InputForm:
    """Make the form of the input from the options; the network itself gives its layout and dtype."""
    if not _normalised(options):
        form = InputForm(mean=IMAGENET_MEAN, std=IMAGENET_STD)
    else:
        form = InputForm(
            scale=1 / 255 if options.scale is None else options.scale,
            mean=options.mean or (0.0, 0.0, 0.0),
            std=options.std or (1.0, 1.0, 1.0),
        )
        if options.scale is None and max(*form.mean, *form.std) > 2.0:
            raise BundleError("--mean and --std are those of pixels from 0 to 255: add --scale 1")
    return form if not options.bgr else InputForm(order="bgr", scale=form.scale, mean=form.mean, std=form.std)


def _normalised(options: argparse.Namespace) -> bool:
    return any(value is not None for value in (options.mean, options.std, options.scale))


def _model_id(name: str, digests: list[str], details: dict[str, object], image: Fit) -> str:
    """Make a model id that differs for every change of the weights, the words or the input."""
    slug = re.sub(r"[^a-z0-9]+", "-", name.lower()).strip("-")[:40] or "network"
    whole = json.dumps([digests, details, image.width, image.height, image.filter], sort_keys=True)
    return f"{KIND}-{slug}-{hashlib.sha256(whole.encode()).hexdigest()[:12]}"


def _text(out: Path, manifest: Manifest, found: NetworkForm) -> str:
    details, form = found.details, found.details.form
    words = details.words.names
    ignored = len(details.words.classes) - len(words)
    how = "bytes as they are"
    if form.dtype == "float32":
        how = f"(pixel * {form.scale:.4g} - {_numbers(form.mean)}) / {_numbers(form.std)}"
    taps = f"{found.features} channels: taps can teach" if found.features else "none: taps cannot teach"
    return "\n".join(
        [
            f"{out}: {manifest.model_id}",
            f"  words       {', '.join(words)}" + (f" ({ignored} ignored)" if ignored else ""),
            f"  input       {found.size[0]}x{found.size[1]} {form.layout} {form.dtype} {form.order}, {how}",
            f'  scores      "{details.output}", {found.maps[0]}x{found.maps[1]}, {details.activation}',
            f"  features    {taps}",
            f"  thresholds  {_thresholds_text(manifest.thresholds)}",
            f'  try it      anytraverse look PICTURE --perceiver {KIND}:{out} --prompts "{words[0]}: 1"',
        ]
    )


def _thresholds_text(thresholds: DefaultThresholds) -> str:
    tile = "none" if thresholds.tile is None else f"{thresholds.tile:g}"
    share = thresholds.tile_share
    return f"roi={thresholds.roi:g},scene={thresholds.scene:g},tile={tile},tile_share={share:g}"


def _numbers(triple: Triple) -> str:
    return ",".join(f"{number:g}" for number in triple)


def _size(text: str) -> tuple[int, int]:
    if not re.fullmatch(r"[0-9]{1,5}x[0-9]{1,5}", text):
        raise argparse.ArgumentTypeError(f'"{text}" is not WIDTHxHEIGHT, e.g. 512x288')
    width, height = text.split("x")
    return int(width), int(height)


def _triple(text: str) -> Triple:
    try:
        red, green, blue = (float(part) for part in text.split(","))
    except ValueError:
        raise argparse.ArgumentTypeError(f'"{text}" is not three numbers, e.g. 0.485,0.456,0.406') from None
    return red, green, blue


def _thresholds(text: str) -> DefaultThresholds:
    values: dict[str, float | None] = asdict(THRESHOLDS)
    try:
        for part in text.split(","):
            name, _, value = part.partition("=")
            if name.strip() not in values:
                raise ValueError(f'"{name.strip()}" is not one of {", ".join(values)}')
            none = name.strip() == "tile" and value.strip() == "none"
            values[name.strip()] = None if none else float(value)
        thresholds = DefaultThresholds(**values)  # type: ignore[arg-type]
        Settings.of(thresholds)
    except (ValueError, AnyTraverseError) as error:
        raise argparse.ArgumentTypeError(f"{error}; write e.g. {_thresholds_text(THRESHOLDS)}") from None
    return thresholds
