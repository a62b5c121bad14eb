"""Reads `config/datasets.toml`: the paper's words, classes and figures by data set."""

from __future__ import annotations

import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any, TypeVar

from anytraverse.evaluation.datasets import ALL
from anytraverse.evaluation.labels import DatasetError, LabelClasses
from anytraverse.preferences import Preferences
from anytraverse.resources import resource

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

FILE = "config/datasets.toml"
_USUAL = "usual"
_Read = TypeVar("_Read")


@dataclass(frozen=True)
class Defaults:
    """Holds what is asked of a data set unless the command says otherwise.

    paper: method -> its mean IoU of drivable ground in the paper, [0, 1].
    """

    split: str = ALL
    words: Preferences = field(default_factory=Preferences)
    drivable: tuple[str, ...] = ()
    unknown: tuple[str, ...] = ()
    paper: Mapping[str, float] = field(default_factory=dict)

    def choose_drivable(self, given: str | None, classes: LabelClasses, more: str = "") -> tuple[str, ...]:
        """Return the drivable classes. given: those of the option, with commas; None: these.

        more: what else helps where neither says them. Raises DatasetError.
        """
        names = self.drivable if given is None else given.split(",")
        if not names:
            raise DatasetError(
                f"which classes are drivable is not known: give --drivable, of {classes.listed}{more}"
            )
        return classes.choose(names)


def read_defaults(kind: str) -> Defaults:
    """Read the section of a kind of data set; without one, empty defaults.

    Raises DatasetError for a file that cannot be used, and OSError.
    """
    return _read(kind, lambda section: Defaults() if section is None else _checked(section))


def usual_classes() -> dict[str, tuple[str, ...]]:
    """Read word -> names of classes that some data sets have for it. Raises as `read_defaults` does."""
    return _read(
        _USUAL, lambda section: {} if section is None else {word: _names(section, word) for word in section}
    )


def _read(name: str, checked: Callable[[Mapping[str, Any] | None], _Read]) -> _Read:
    file = resource(FILE)
    try:
        return checked(tomllib.loads(file.read_text(encoding="utf-8")).get(name))
    except (
        ValueError,
        TypeError,
        AttributeError,
    ) as error:  # tomllib's errors, Unicode's and ours among them
        raise DatasetError(
            f"{file}, [{name}]: {error}: mend it, or install anytraverse-companion again"
        ) from error


def _checked(section: Mapping[str, Any]) -> Defaults:
    known = {"split", "words", "drivable", "unknown", "paper"}
    if strange := sorted(section.keys() - known):
        raise ValueError(f"{strange[0]} is no key: there are {', '.join(sorted(known))}")
    paper = {str(method): float(iou) for method, iou in section.get("paper", {}).items()}
    if any(not 0.0 <= iou <= 1.0 for iou in paper.values()):
        raise ValueError("paper holds a number that is no IoU from 0 to 1")
    return Defaults(
        split=str(section.get("split", ALL)),
        words=Preferences.of(section.get("words", {})),
        drivable=_names(section, "drivable"),
        unknown=_names(section, "unknown"),
        paper=paper,
    )


def _names(section: Mapping[str, Any], key: str) -> tuple[str, ...]:
    names = section.get(key, [])
    if not isinstance(names, list) or not all(isinstance(name, str) for name in names):
        raise ValueError(f"{key} is no list of classes")
    return tuple(names)
