"""Defines what an answer may change: the operations on words, examples and remembered scenes."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True)
class SetWord:
    """Give `word` a weight in [-1, 1]."""

    word: str
    weight: float


@dataclass(frozen=True)
class Tap:
    """Make the contents of `box` in frame `frame_id` an example of `word`, with a weight in [-1, 1].

    box: left, top, right, bottom in fractions of the frame.
    """

    frame_id: int
    box: tuple[float, float, float, float]
    word: str
    weight: float


@dataclass(frozen=True)
class ForgetWord:
    """Take `word` out of use."""

    word: str


@dataclass(frozen=True)
class ForgetCall:
    """Remove from the history what the answer to call `id` taught."""

    id: int


@dataclass(frozen=True)
class NewEpisode:
    """Forget the reference and all answered scenes."""


@dataclass(frozen=True)
class OtherPlace:
    """Refuse the newest match. id: the call whose scene matched, 0: whichever did."""

    id: int = 0


Operation = SetWord | Tap | ForgetWord | ForgetCall | NewEpisode | OtherPlace


def weights_of(operations: Iterable[Operation]) -> dict[str, float]:
    """Return the weight of each word that is set without a tap; of two, the last one counts."""
    return {one.word: one.weight for one in operations if isinstance(one, SetWord)}


def taps_of(operations: Iterable[Operation]) -> list[Tap]:
    """Return the taps."""
    return [one for one in operations if isinstance(one, Tap)]


def teaches(operations: Iterable[Operation]) -> bool:
    """Return whether something is said of the call's scene. That it is another place says nothing of it."""
    return any(not isinstance(one, OtherPlace) for one in operations)
