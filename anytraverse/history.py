"""Stores answered scenes: H = {(e_c, tau_c)} of the paper, with a limit on their number."""

from __future__ import annotations

import math
from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from itertools import islice, takewhile
from weakref import WeakKeyDictionary

import numpy as np
from numpy.typing import NDArray

from anytraverse.perception import Example
from anytraverse.preferences import Preferences

_ROUNDING = 1e-9
"""Two cosines that differ by less are equal: sums of products depend on how many are made at once."""
MAX_REFUSED = 8
"""Frames of other places that an entry keeps. An entry that matches falsely more often is forgotten."""

Embedding = NDArray[np.float32]
"""A unit-norm scene embedding, (d,) float32."""


@dataclass(frozen=True)
class Place:
    """Holds where and when a frame was taken, as far as known; None where a value is not known.

    latitude, longitude: degrees. heading: degrees clockwise from north. time: seconds since 1970.
    attitude: roll, pitch and yaw, degrees; positive to the right, up, and clockwise from north.
    """

    latitude: float | None = None
    longitude: float | None = None
    heading: float | None = None
    time: float | None = None
    attitude: tuple[float, float, float] | None = None


ALONE = 0.7
"""Of the strangeness that several scenes allow: what one allows by itself. Up to all of it, one scene
resembled 2.5 % of foreign frames, and up to this share 0.1 %.
"""
NEIGHBOURS = 8
"""The most of them that a frame is compared with, so that a rover may know several regions."""


@dataclass(frozen=True, eq=False)
class Entry:
    """Holds one answered scene: its embedding and all words that were in force after the answer.

    order: the stamp of its making, unique. matched: the stamp of its last match.
    call_id: the call that was answered; 0 for the first scene, which became the reference without a call.
    refused: embeddings of frames that matched it, and that an operator said show another place, at most 8.
    surroundings: what its frame shows apart from the place, see `History.strangeness`; None where the
    perceiver does not tell.
    """

    embedding: Embedding
    preferences: Preferences
    order: int
    matched: int
    call_id: int = 0
    examples: Mapping[str, tuple[Example, ...]] = field(default_factory=dict)
    place: Place = field(default_factory=Place)
    refused: tuple[Embedding, ...] = ()
    surroundings: Embedding | None = None


@dataclass(frozen=True, eq=False)
class Match:
    """Holds the entry most similar to a frame, and their cosine."""

    entry: Entry
    similarity: float


@dataclass(frozen=True)
class Likeness:
    """Holds the scene that a frame of a new place lacks least to count as. Cosines.

    call_id: the call that it was answered at, 0 for a scene without one. similarity: to that scene.
    needed: from which the frame would have counted as that place.
    """

    call_id: int
    similarity: float
    needed: float


def is_embedding(vector: Embedding) -> bool:
    """Return whether `vector` can be compared: it is one vector, finite and not zero."""
    return math.isfinite(cosine(vector, vector))


def cosine(one: Embedding, other: Embedding) -> float:
    """Return the cosine of two embeddings, in [-1, 1]; they need not be of unit norm.

    Returns NaN, which meets no threshold, unless both are finite vectors of one length and not zero.
    """
    if one.ndim != 1 or one.shape != other.shape:
        return math.nan
    long, other_long = one.astype(np.float64), other.astype(np.float64)
    product = math.sqrt(float(long @ long)) * math.sqrt(float(other_long @ other_long))
    if not 0.0 < product < math.inf:
        return math.nan
    return min(1.0, max(-1.0, float(long @ other_long) / product))


class _Rows:
    """Holds embeddings of one length, one a row, ready to be compared with many frames."""

    def __init__(self, rows: NDArray[np.float32]) -> None:
        self._wide = rows.astype(np.float64)
        self._norms = np.linalg.norm(self._wide, axis=1)

    def cosines(self, vector: Embedding) -> NDArray[np.float64]:
        long = vector.astype(np.float64)
        norms = self._norms * np.linalg.norm(long)
        with np.errstate(divide="ignore", invalid="ignore"):
            similarities = np.clip(self._wide @ long / norms, -1.0, 1.0)
        return np.where(np.isfinite(norms), similarities, np.nan)


def _refuses(entry: Entry, embedding: Embedding, similarity: float) -> bool:
    """Return whether a refused frame resembles this one as much as the entry does, or cannot be compared."""
    return any(not cosine(one, embedding) < similarity - _ROUNDING for one in entry.refused)


class History(Sequence[Entry]):
    """Holds an immutable sequence of entries. Beyond `limit`, the least recently matched are removed."""

    def __init__(self, entries: Sequence[Entry] = (), limit: int = 256) -> None:
        kept = sorted(entries, key=lambda entry: entry.matched, reverse=True)[:limit]
        self._entries = tuple(sorted(kept, key=lambda entry: entry.order))
        self.limit = limit

    def __getitem__(self, index: int) -> Entry:  # type: ignore[override]
        return self._entries[index]

    def __iter__(self) -> Iterator[Entry]:
        return iter(self._entries)

    def __len__(self) -> int:
        return len(self._entries)

    def best(self, embedding: Embedding) -> Match | None:
        """Return the MOST similar entry (argmax of the cosine), whatever the cosine; of equals the newest.

        Left out are those that `matches` leaves out. None when none is left.
        """
        return next(self.nearest(embedding), None)

    def matches(self, embedding: Embedding, least: float) -> list[Match]:
        """Return the entries that a frame resembles by a cosine of at least `least`, the most similar first.

        Entries whose embedding is not finite or has another length are left out, and those to which the frame
        is not more similar than to a frame that was refused as another place.
        """
        return list(takewhile(lambda match: match.similarity >= least, self.nearest(embedding)))

    def nearest(self, embedding: Embedding) -> Iterator[Match]:
        """Yield all entries, the most similar first, but for those that `matches` leaves out."""
        if embedding.ndim != 1:
            return
        fitting, rows = self._comparable(embedding.size)
        if not fitting:
            return
        similarities = rows.cosines(embedding)
        for index in np.argsort(-similarities, kind="stable"):  # NaN comes last
            entry, similarity = fitting[index], float(similarities[index])
            if math.isfinite(similarity) and not _refuses(entry, embedding, similarity):
                yield Match(entry, similarity)

    def _comparable(self, length: int) -> tuple[list[Entry], _Rows]:
        """Return the entries whose embeddings have this length, the newest first, and these embeddings."""
        known = _COMPARABLE.get(self)
        if known is None or known[0] != length:
            fitting = [entry for entry in reversed(self._entries) if entry.embedding.shape == (length,)]
            rows = np.array([entry.embedding for entry in fitting], np.float32).reshape(len(fitting), length)
            known = _COMPARABLE[self] = (length, fitting, _Rows(rows))
        return known[1], known[2]

    def refusing(self, orders: Collection[int], embedding: Embedding) -> History:
        """Return this history with a frame of another place noted at the entries of these stamps.

        An entry that has `MAX_REFUSED` of them already is forgotten: it is no use as a place.
        """
        entries = []
        for entry in self._entries:
            if entry.order not in orders:
                entries.append(entry)
            elif len(entry.refused) < MAX_REFUSED:
                entries.append(replace(entry, refused=(*entry.refused, embedding)))
        return History(entries, self.limit)

    def is_refused(self, embedding: Embedding, least: float) -> bool:
        """Return whether a frame resembles a refused one by a cosine of at least `least`."""
        return any(cosine(one, embedding) >= least for entry in self._entries for one in entry.refused)

    def strangeness(self, surroundings: Embedding, words: Preferences) -> float | None:
        """Return how strange a frame's surroundings are to the remembered scenes whose words are in force.

        It is the squared distance to the mean of the k `NEIGHBOURS` nearest ones, times k / (k + 1), since a
        mean of few is uncertain; or that to the nearest one alone, where it is so near that this is less: a
        region that is entered has one scene at first, and the others would draw the mean away from it. A
        perceiver scales its vectors so that most frames of one region stay below 1. None where no scene can
        be compared. surroundings, (n,): of the frame.
        """
        entries, apart, squares = self._apart(surroundings)
        in_force = (
            index
            for index in np.argsort(squares, kind="stable")
            if all(words.get(word) == weight for word, weight in entries[index].preferences.items())
        )
        nearest = list(islice(in_force, NEIGHBOURS))
        if not nearest:
            return None
        alone = float(squares[nearest[0]]) / 2 / ALONE
        if len(nearest) == 1:
            return alone
        mean = apart[nearest].mean(axis=0)
        return min(alone, float(mean @ mean) * len(nearest) / (len(nearest) + 1))

    def nearest_strangeness(self, surroundings: Embedding) -> float | None:
        """Return how strange a frame's surroundings are to the nearest scene, of any words; None without one.

        It is half the squared distance, as a strangeness to one scene.
        """
        _, _, squares = self._apart(surroundings)
        return float(squares.min()) / 2 if len(squares) else None

    def _apart(self, surroundings: Embedding) -> tuple[list[Entry], NDArray[np.float64], NDArray[np.float64]]:
        """Return the entries that can be compared, how they differ from a frame (m, n), squared (m,)."""
        known = _SURROUNDINGS.get(self)
        if known is None or known[1].shape[1] != surroundings.size:
            entries, vectors = list[Entry](), list[Embedding]()
            for entry in self._entries:
                if entry.surroundings is not None and entry.surroundings.shape == surroundings.shape:
                    entries.append(entry)
                    vectors.append(entry.surroundings)
            rows = np.array(vectors, np.float64).reshape(len(vectors), surroundings.size)
            known = _SURROUNDINGS[self] = (entries, rows)
        apart = known[1] - surroundings
        return known[0], apart, np.einsum("ij,ij->i", apart, apart)

    def added(self, entry: Entry) -> History:
        """Return this history with one more entry."""
        return History((*self._entries, entry), self.limit)

    def touched(self, entry: Entry, order: int) -> History:
        """Return this history with `entry` stamped as matched at `order`."""
        return History(
            [replace(one, matched=order) if one.order == entry.order else one for one in self._entries],
            self.limit,
        )

    def without_call(self, call_id: int) -> History:
        """Return this history without the entry that the answer to one call made."""
        return History([entry for entry in self._entries if entry.call_id != call_id], self.limit)


_COMPARABLE: WeakKeyDictionary[History, tuple[int, list[Entry], _Rows]] = WeakKeyDictionary()
"""History -> length, entries and rows of `_comparable`, since every frame of a changed scene is compared.
They are no attribute: attributes are sent from process to process.
"""
_SURROUNDINGS: WeakKeyDictionary[History, tuple[list[Entry], NDArray[np.float64]]] = WeakKeyDictionary()
"""History -> entries and rows of `_apart`, since every frame is compared. No attribute, as above."""
