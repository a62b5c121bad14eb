"""Judges the frames of a data set one by one, and goes on where a run before was killed."""

from __future__ import annotations

from collections.abc import Iterator

from anytraverse.evaluation.datasets import Dataset, TornPictureError
from anytraverse.evaluation.labels import DatasetError
from anytraverse.evaluation.progress import Progress
from anytraverse.evaluation.records import Records
from anytraverse.evaluation.seeing import PerceiverRun
from anytraverse.evaluation.tally import Rows, Tally


class Evaluation:
    """Iterates over (number, tally) of the chosen frames, in order, and shows the progress on stderr.

    A frame whose tally is stored is not judged again. resumed: how many those are. torn: the number of frames
    that could not be read; a later run tries them again.
    """

    def __init__(self, dataset: Dataset, seeing: PerceiverRun, records: Records) -> None:
        self._dataset = dataset
        self._seeing = seeing
        self._records = records
        self._rows = Rows(dataset.classes)
        self.torn = 0
        self.resumed = sum(
            records.holds(dataset.name(number), files)
            for number, files in zip(dataset.numbers, dataset.files, strict=True)
        )

    def __iter__(self) -> Iterator[tuple[int, Tally]]:
        """Raises DatasetError when every frame is damaged or records cannot be written; PerceiverError."""
        progress = Progress(len(self._dataset) - self.resumed, "frames")
        if self.resumed:
            progress.say(f"{self.resumed} frames were judged before and are not judged again")
        try:
            yield from self._tallies(progress)
        finally:
            progress.close()
        if self.torn == len(self._dataset):
            raise DatasetError(f"{self._dataset.path} has no frame that can be read: copy the folder again")

    def _tallies(self, progress: Progress) -> Iterator[tuple[int, Tally]]:
        for number, files in zip(self._dataset.numbers, self._dataset.files, strict=True):
            name = self._dataset.name(number)
            tally = self._records.get(name, files)
            if tally is None:
                try:
                    frame = self._dataset.read(number)
                except TornPictureError as error:
                    self.torn += 1
                    progress.say(f"{error}, skipped")
                else:
                    tally = Tally.of(self._seeing.look(frame), frame, self._rows)
                    self._records.add(name, files, tally)
                progress.step()
            if tally is not None:
                yield number, tally
