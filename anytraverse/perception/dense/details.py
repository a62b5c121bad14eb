"""Reads and writes the part of a manifest that describes a dense model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass
from typing import Any

from anytraverse.bundle.fields import Fields
from anytraverse.errors import BundleError
from anytraverse.preferences import MAX_WORDS

FAMILIES = ("siglip", "tipsv2")
MOST_TEMPLATES = 16
MOST_ABSENT = 512
MOST_WORDS = 4096
GROUP = MAX_WORDS
"""As many absent words are taken together in the calibration as a rover may be asked to look for."""

_SLOT = "{}"


@dataclass(frozen=True)
class ScoreCalibration:
    """Says how a score becomes an attention: sigmoid((score - threshold) / temperature).

    frames: on how many it was measured. chance: the share of places that `GROUP` absent words explain.
    """

    threshold: float
    temperature: float
    frames: int
    chance: float


@dataclass(frozen=True)
class DenseDetails:
    """Describes a dense model.

    family: its architecture, one of `FAMILIES`. grid: patches along a side. width: values of a feature.
    templates: texts with "{}" for the word. words: those whose embeddings are in the bundle.
    absent: words for things that are not expected on the ground.
    calibration: None before `bundle check --frames` has measured it.
    """

    family: str
    grid: int
    width: int
    templates: tuple[str, ...]
    words: tuple[str, ...]
    absent: tuple[str, ...]
    calibration: ScoreCalibration | None = None

    def __post_init__(self) -> None:
        check_templates(self.templates)
        if len(self.words) > MOST_WORDS or len(set(self.words)) < len(self.words):
            raise BundleError(f"{len(self.words)} words: give {MOST_WORDS} at most, each of them once")
        if not GROUP <= len(self.absent) <= MOST_ABSENT or len(set(self.absent)) < len(self.absent):
            raise BundleError(
                f"{len(self.absent)} absent words: give {GROUP} to {MOST_ABSENT}, each of them once"
            )


def check_templates(templates: Sequence[str]) -> None:
    """Raise BundleError unless there are 1 to 16 templates, each with one "{}" and no other brace."""
    if not 1 <= len(templates) <= MOST_TEMPLATES or len(set(templates)) < len(templates):
        raise BundleError(f"{len(templates)} templates: give 1 to {MOST_TEMPLATES}, each of them once")
    for template in templates:
        if template.count(_SLOT) != 1 or template.count("{") != 1 or template.count("}") != 1:
            raise BundleError(f'the template "{template[:60]}" must hold {_SLOT} once, and no other brace')
        if not template.isprintable() or len(template) > 200:
            raise BundleError(f'the template "{template[:60]}" must be one line of 200 characters at most')


def filled(template: str, word: str) -> str:
    """Put the word into a template. A word may hold braces itself."""
    return template.replace(_SLOT, word)


def as_json(details: DenseDetails) -> dict[str, Any]:
    """Return the JSON object that `read_details` reads."""
    values = asdict(details)
    return values | {name: list(values[name]) for name in ("templates", "words", "absent")}


def read_details(values: Mapping[str, Any], where: str) -> DenseDetails:
    """Read the details of a manifest; `where` names it in error messages. Raises BundleError."""
    fields = Fields(dict(values), where)
    fields.only(("family", "grid", "width", "templates", "words", "absent", "calibration"))
    calibration = None if fields.any("calibration") is None else _calibration(fields.object("calibration"))
    family = fields.choice("family", FAMILIES)
    grid, width = fields.whole("grid", 2, 1024), fields.whole("width", 1, 1 << 14)
    try:
        templates, words = fields.texts("templates"), fields.texts("words")
        return DenseDetails(family, grid, width, templates, words, fields.texts("absent"), calibration)
    except BundleError as error:
        raise BundleError(f"{where}: {error}") from None


def _calibration(fields: Fields) -> ScoreCalibration:
    fields.only(("threshold", "temperature", "frames", "chance"))
    return ScoreCalibration(
        fields.number("threshold", -2.0, 2.0),
        fields.number("temperature", 1e-6, 2.0),
        fields.whole("frames", 1, 1 << 20),
        fields.number("chance", 0.0, 1.0),
    )
