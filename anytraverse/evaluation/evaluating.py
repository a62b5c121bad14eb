"""Judges the frames of a data set one by one, with one set of words or several, and none of them twice."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

from anytraverse.evaluation.datasets import Dataset, Files, TornPictureError
from anytraverse.evaluation.labels import DatasetError
from anytraverse.evaluation.progress import Progress
from anytraverse.evaluation.records import Records
from anytraverse.evaluation.seeing import PerceiverRun
from anytraverse.evaluation.tally import Rows, Tally

Judged = tuple[int, tuple[Tally, ...]]
"""A frame's number, and its tally with each set of words."""


class Evaluation:
    """Iterates over the chosen frames, in order, and shows the progress on stderr.

    A frame is encoded once for all sets of words, and not judged with words for which its tally is stored.
    resumed: how many frames need no judging. torn: the number of frames that could not be read; a later run
    tries them again.
    """

    def __init__(self, dataset: Dataset, runs: Sequence[PerceiverRun], records: Records) -> None:
        """runs: of one perceiver, at most `records.MOST_WORDS`."""
        self._dataset = dataset
        self._runs = runs
        self._records = records
        self._rows = Rows(dataset.classes)
        self._keys = [records.use(run.words) for run in runs]
        self.torn = 0
        self.resumed = sum(
            all(records.holds(key, dataset.name(number), files) for key in self._keys)
            for number, files in zip(dataset.numbers, dataset.files, strict=True)
        )

    def __iter__(self) -> Iterator[Judged]:
        """Raises DatasetError when every frame is damaged or records cannot be written; PerceiverError."""
        progress = Progress(len(self._dataset) - self.resumed, "frames")
        if self.resumed:
            progress.say(f"{self.resumed} frames were judged before and are not judged again")
        try:
            for number, files in zip(self._dataset.numbers, self._dataset.files, strict=True):
                name = self._dataset.name(number)
                stored = [self._records.get(key, name, files) for key in self._keys]
                whole = tuple(tally for tally in stored if tally is not None)
                if len(whole) == len(stored):
                    yield number, whole
                    continue
                try:
                    judged = self._judged(number, files, stored)
                except TornPictureError as error:
                    self.torn += 1
                    progress.say(f"{error}, skipped")
                else:
                    yield number, judged
                progress.step()
        finally:
            progress.close()
        if self.torn == len(self._dataset):
            raise DatasetError(f"{self._dataset.path} has no frame that can be read: copy the folder again")

    def _judged(self, number: int, files: Files, stored: Sequence[Tally | None]) -> tuple[Tally, ...]:
        """Return a frame's tallies, and store those that were not."""
        frame = self._dataset.read(number)
        features = self._runs[0].perceiver.encode(frame.image) if len(self._runs) > 1 else None
        tallies = []
        for key, run, known in zip(self._keys, self._runs, stored, strict=True):
            tally = known or Tally.of(run.look(frame, features), frame, self._rows)
            if known is None:
                self._records.add(key, self._dataset.name(number), files, tally)
            tallies.append(tally)
        return tuple(tallies)
