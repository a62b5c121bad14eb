"""Applies the merges of byte-pair encoding."""

from __future__ import annotations

from array import array
from collections.abc import Iterable, Mapping
from heapq import heapify, heappop, heappush


class Merges:
    """Holds pairs of tokens in order of rank; a merged pair is a token too.

    Raises ValueError for a merge of something that is no token of the vocabulary (token -> id >= 0).
    """

    def __init__(self, vocabulary: Mapping[str, int], merges: Iterable[tuple[str, str]]) -> None:
        self._stride = max(vocabulary.values()) + 1
        self._ranks: dict[int, int] = {}
        self._products = array("q")
        for rank, (left, right) in enumerate(merges):
            for token in (left, right, left + right):
                if token not in vocabulary:
                    raise ValueError(
                        f"merge {rank} needs {token[:40]!r}, which is no token of the vocabulary"
                    )
            self._ranks[vocabulary[left] * self._stride + vocabulary[right]] = rank
            self._products.append(vocabulary[left + right])

    def apply(self, ids: list[int]) -> list[int]:
        """Apply all merges, always to the pair of the lowest rank, the leftmost of equals, in O(n log n).

        before, after: a doubly linked list of the places that are left. A place merged away gets id -1.
        """
        size = len(ids)
        before, after = list(range(-1, size - 1)), list(range(1, size + 1))

        def rank_at(place: int) -> int | None:
            following = after[place]
            return self._ranks.get(ids[place] * self._stride + ids[following]) if following < size else None

        queue = [(rank, place) for place in range(size) if (rank := rank_at(place)) is not None]
        heapify(queue)
        while queue:
            rank, place = heappop(queue)
            current = rank_at(place)
            if current is None or self._products[current] != self._products[rank]:
                continue  # the queue's entry is outdated: another merge took one of the pair
            merged_away = after[place]
            ids[place], ids[merged_away] = self._products[rank], -1
            after[place] = after[merged_away]
            if after[place] < size:
                before[after[place]] = place
            for neighbour in (before[place], place):
                if neighbour >= 0 and (rank_now := rank_at(neighbour)) is not None:
                    heappush(queue, (rank_now, neighbour))
        return [token_id for token_id in ids if token_id >= 0]
