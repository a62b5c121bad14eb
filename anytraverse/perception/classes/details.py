"""Reads and writes the part of a manifest that describes a segmentation network."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from anytraverse.bundle.fields import Fields
from anytraverse.errors import BundleError
from anytraverse.frame import Image
from anytraverse.perception.classes.words import ClassWords, NamedClass

LAYOUTS = ("nchw", "nhwc")
DTYPES = ("float32", "uint8")
ORDERS = ("rgb", "bgr")
ACTIVATIONS = ("softmax", "probabilities", "sigmoid", "none")
MOST_CLASSES = 1000

Triple = tuple[float, float, float]


@dataclass(frozen=True)
class InputForm:
    """Describes how the pixels of a resized frame become a network's input.

    float32: (pixel * scale - mean) / std, mean and std in the network's channel order. uint8: unchanged.
    Raises BundleError for a name that is not in `LAYOUTS`, `DTYPES` or `ORDERS`, and for a number that is not
    finite; scale and std must be above 0.
    """

    layout: str = "nchw"
    dtype: str = "float32"
    order: str = "rgb"
    scale: float = 1 / 255
    mean: Triple = (0.0, 0.0, 0.0)
    std: Triple = (1.0, 1.0, 1.0)

    def __post_init__(self) -> None:
        for name, choices in (("layout", LAYOUTS), ("dtype", DTYPES), ("order", ORDERS)):
            if getattr(self, name) not in choices:
                raise BundleError(f"{name} is {getattr(self, name)!r}: choose {' or '.join(choices)}")
        if not all(math.isfinite(number) for number in (self.scale, *self.mean, *self.std)):
            raise BundleError("scale, mean and std must be finite numbers")
        if self.scale <= 0 or min(self.std) <= 0:
            raise BundleError("scale and std must be above 0")

    def tensor(self, picture: Image) -> NDArray[Any]:
        """Make the input for a picture, (height, width, 3) uint8 RGB: a batch of one, (1, ...)."""
        pixels = picture if self.order == "rgb" else picture[..., ::-1]
        height, width = pixels.shape[:2]
        shape = (1, 3, height, width) if self.layout == "nchw" else (1, height, width, 3)
        tensor = np.empty(shape, dtype=self.dtype)
        planes = tensor[0] if self.layout == "nchw" else np.moveaxis(tensor[0], 2, 0)
        for channel, plane in enumerate(planes):
            if self.dtype == "uint8":
                plane[...] = pixels[..., channel]
            else:
                gain, shift = self.scale / self.std[channel], self.mean[channel] / self.std[channel]
                np.multiply(pixels[..., channel], np.float32(gain), out=plane, dtype=np.float32)
                np.subtract(plane, np.float32(shift), out=plane)
        return tensor


@dataclass(frozen=True)
class ClassesDetails:
    """Describes a segmentation network.

    words: of its classes. form: of its input. output: the name of the output with the scores.
    activation: one of `ACTIVATIONS`. softmax, sigmoid: must be applied to the scores; probabilities: the
    network ends in a softmax itself; none: its values are in [0, 1] already, each class by itself.
    """

    words: ClassWords
    activation: str
    form: InputForm
    output: str

    def __post_init__(self) -> None:
        count = len(self.words.classes)
        if self.activation not in ACTIVATIONS:
            raise BundleError(f'activation is "{self.activation}": choose {", ".join(ACTIVATIONS)}')
        if self.shares and count == 1:
            raise BundleError("a single class has no softmax: the activation must be sigmoid or none")
        if count > MOST_CLASSES:
            raise BundleError(f"{count} classes: {MOST_CLASSES} at most")

    @property
    def shares(self) -> bool:
        """Whether the values of all classes sum to 1 at each pixel."""
        return self.activation in ("softmax", "probabilities")


def as_json(details: ClassesDetails) -> dict[str, Any]:
    """Return the JSON object that `read_details` reads."""
    classes, form = details.words.classes, details.form
    return {
        "classes": [{"name": each.name, "synonyms": list(each.synonyms)} for each in classes],
        "ignore": [each.name for each in classes if not each.is_word],
        "activation": details.activation,
        "output": details.output,
        "input": {
            "layout": form.layout,
            "dtype": form.dtype,
            "order": form.order,
            "scale": form.scale,
            "mean": list(form.mean),
            "std": list(form.std),
        },
    }


def read_details(values: Mapping[str, Any], where: str) -> ClassesDetails:
    """Read the details of a manifest; `where` names it in error messages. Raises BundleError."""
    fields = Fields(dict(values), where)
    fields.only(("classes", "ignore", "activation", "output", "input"))
    ignored = set(fields.texts("ignore"))
    classes = [_named(each, ignored) for each in _objects(fields, "classes")]
    unknown = ignored - {each.name for each in classes}
    if unknown:
        raise fields.unfit("ignore", "names of classes", f'"{min(unknown)}"')
    activation, output = fields.choice("activation", ACTIVATIONS), fields.text("output")
    form = _form(fields.object("input"))
    try:
        return ClassesDetails(ClassWords(classes), activation, InputForm(**form), output)
    except BundleError as error:
        raise BundleError(f"{where}: {error}") from None


def _objects(fields: Fields, name: str) -> Iterator[Fields]:
    values = fields.any(name)
    if not isinstance(values, list):
        raise fields.unfit(name, "a list", type(values).__name__)
    return (Fields(value, f"{fields.where}: {name}: {index}") for index, value in enumerate(values))


def _named(fields: Fields, ignored: set[str]) -> NamedClass:
    fields.only(("name", "synonyms"))
    name = fields.text("name")
    return NamedClass(name, fields.texts("synonyms"), name not in ignored)


def _form(fields: Fields) -> dict[str, Any]:
    fields.only(("layout", "dtype", "order", "scale", "mean", "std"))
    return {
        "layout": fields.choice("layout", LAYOUTS),
        "dtype": fields.choice("dtype", DTYPES),
        "order": fields.choice("order", ORDERS),
        "scale": fields.number("scale", 0.0, 1e6),
        "mean": _triple(fields, "mean"),
        "std": _triple(fields, "std"),
    }


def _triple(fields: Fields, name: str) -> Triple:
    values = fields.any(name)
    if not isinstance(values, list) or len(values) != 3:
        raise fields.unfit(name, "three numbers", type(values).__name__)
    items = Fields({str(index): value for index, value in enumerate(values)}, f"{fields.where}: {name}")
    first, second, third = (items.number(index, -1e6, 1e6) for index in items)
    return first, second, third
