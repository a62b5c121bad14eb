"""Copies the files of a network into a bundle."""

from __future__ import annotations

import shutil
from pathlib import Path

from anytraverse.errors import BundleError, PerceiverError
from anytraverse.perception.runtime import Runtime, open_session

FILE = "network.onnx"


def copy_network(model: Path, folder: Path) -> list[str]:
    """Copy a network to `folder` as `FILE`, and its weights in MODEL.onnx.data, if it needs that file.

    Returns the names of the copies, the network's first. Raises PerceiverError when it cannot be loaded,
    BundleError when it has its weights in files of other names, and OSError.
    """
    shutil.copyfile(model, folder / FILE)
    weights = Path(f"{model}.data")
    try:
        open_session(folder / FILE, Runtime())
        return [FILE]
    except PerceiverError:
        if weights.is_file():
            shutil.copyfile(weights, folder / weights.name)
    try:
        open_session(folder / FILE, Runtime())
    except PerceiverError as error:
        if _loads(model):
            raise BundleError(
                f"{model} keeps its weights in other files than {weights.name}: make it one file, with the "
                f'package onnx: onnx.save(onnx.load("{model.name}"), "one-file.onnx")'
            ) from None
        raise error
    return [FILE, weights.name]


def _loads(model: Path) -> bool:
    try:
        open_session(model, Runtime())
    except PerceiverError:
        return False
    return True
