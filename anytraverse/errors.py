"""Every error that anytraverse raises on purpose.

AnyTraverseError
├── PreferencesError        words or weights that cannot be used
│   └── UnknownWordError    a word that the perceiver cannot ground
├── RegionError             a box or region that is not one
├── SettingsError           a number of the judging that is out of its range
├── ExampleError            a tapped box that teaches nothing, or an example of another model
├── PerceiverError          a perceiver that cannot be made or has failed
│   └── BundleError         a bundle of networks that is torn, foreign, newer or unsuitable
└── TrainingError           frames or options that a training cannot use
"""

from __future__ import annotations


class AnyTraverseError(Exception):
    """Base of all errors raised on purpose; its text tells what to do next."""


class PreferencesError(AnyTraverseError, ValueError):
    """Words or weights that cannot be used."""


class UnknownWordError(PreferencesError):
    """A word that the perceiver cannot ground.

    `known` lists the words it can; the remedy is one of them, or a tapped example.
    """

    def __init__(self, word: str, known: tuple[str, ...]) -> None:
        self.word = word
        self.known = known
        super().__init__(
            f'"{word}" is not a word it knows: {", ".join(known)}. '
            "Use one of these, or tap the thing in the picture to teach it."
        )


class RegionError(AnyTraverseError, ValueError):
    """A box or region that is not one."""


class SettingsError(AnyTraverseError, ValueError):
    """A threshold or another number of the judging that is out of its range."""


class ExampleError(AnyTraverseError, ValueError):
    """A tapped box that teaches nothing, or an example made by another model."""


class PerceiverError(AnyTraverseError, RuntimeError):
    """A perceiver that cannot be made, or that has failed on a frame."""


class BundleError(PerceiverError):
    """A bundle of networks that is torn, foreign, newer than this program, or unsuitable."""


class TrainingError(AnyTraverseError, ValueError):
    """Labelled frames or options that a training cannot use."""
