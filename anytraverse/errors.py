"""Defines every error that anytraverse raises on purpose.

AnyTraverseError
├── PreferencesError        words or weights that cannot be used
│   └── UnknownWordError    a word that the perceiver cannot ground
├── RegionError             a box with sides out of range, or an empty one
├── SettingsError           a threshold or another setting that is out of its range
├── ExampleError            a tapped box that no example can be made of, or another model's example
├── PerceiverError          a perceiver that cannot be made or has failed
│   └── BundleError         a bundle that is damaged, of another kind, of a newer format, or unsuitable
└── TrainingError           frames or options that a training cannot use
"""

from __future__ import annotations


class AnyTraverseError(Exception):
    """Serves as the base of all errors raised on purpose. Its text says what to do next."""


def file_error(error: OSError) -> str:
    """Return which file could not be used and why, without the error's number."""
    return f"{error.filename}: {(error.strerror or str(error)).lower()}"


class PreferencesError(AnyTraverseError, ValueError):
    """Reports words or weights that cannot be used."""


class UnknownWordError(PreferencesError):
    """Reports a word that the perceiver cannot ground.

    `known` lists the words that it can ground. The remedy is one of these, or a tapped example.
    """

    def __init__(self, word: str, known: tuple[str, ...]) -> None:
        self.word = word
        self.known = known
        super().__init__(
            f'"{word}" is not a word it knows: {", ".join(known)}. '
            "Use one of these, or tap the thing in the picture to teach it."
        )


class RegionError(AnyTraverseError, ValueError):
    """Reports a box with sides out of range, or an empty one."""


class SettingsError(AnyTraverseError, ValueError):
    """Reports a threshold or another setting that is out of its range."""


class ExampleError(AnyTraverseError, ValueError):
    """Reports a tapped box that no example can be made of, or an example made by another model."""


class PerceiverError(AnyTraverseError, RuntimeError):
    """Reports a perceiver that cannot be made, or that has failed on a frame."""


class BundleError(PerceiverError):
    """Reports a bundle that is damaged, of another kind, newer than this program, or unsuitable."""


class TrainingError(AnyTraverseError, ValueError):
    """Reports labelled frames or options that a training cannot use."""
