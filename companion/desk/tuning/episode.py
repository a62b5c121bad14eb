"""What is judged by many combinations: a drive, by name, so that every process can open it."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from anytraverse.evaluation.datasets import Dataset, Selection, TornPictureError, open_dataset
from anytraverse.frame import Image
from companion.desk.drives.desk import AnswerFile
from companion.desk.drives.drive import Drive, DriveError, DriveFrame, printable
from companion.desk.drives.frames import open_drive
from companion.desk.drives.recorded import RecordedDrive
from companion.desk.tuning.operators import Given, GivenAnswers, LabelOperator, Operator, go
from companion.wire.typed_answers import read_typed


@dataclass(frozen=True)
class Episode:
    """Names a drive and who answers its calls.

    where: a drive, or a data set where it is labelled. rate: frames a second. answers: given before.
    drivable: classes by which the labels answer; None: the drive has no labels, or they do not answer.
    """

    where: str
    rate: float
    answers: tuple[Given, ...] = ()
    split: str = "all"
    selection: Selection | None = None
    drivable: tuple[str, ...] | None = None

    def opened(self) -> tuple[Drive, Operator]:
        """Open the drive, and make its operator. Raises DriveError, DatasetError, OSError."""
        if self.drivable is not None:
            dataset = open_dataset(self.where, self.split, self.selection)
            return LabelledDrive(dataset, self.rate), LabelOperator.of(dataset, self.drivable)
        operator = GivenAnswers(self.answers) if self.answers else go
        return open_drive(self.where, self.rate), operator


def given_answers(drive: Drive, answers: str | None) -> tuple[Given, ...]:
    """Return the answers in the file `answers`; without one, those that the recording of the drive holds.

    Raises DriveError for a file without an answer to one of its frames, OSError.
    """
    if answers is not None:
        file = AnswerFile(Path(answers))
        found = [(one.at, read_typed(line)) for one in drive.frames() for line in file.of(one.name)]
        if not found:
            raise DriveError(
                f"{answers} has no answer to a frame of this drive: give the one of its rehearsal"
            )
        return tuple(found)
    if isinstance(drive, RecordedDrive):
        return tuple((at, read_typed(line)) for at, line in drive.answers())
    return ()


class LabelledDrive:
    """The frames of a labelled data set in their order, as a drive."""

    def __init__(self, dataset: Dataset, rate: float) -> None:
        self.title, self.count = printable(dataset.title), len(dataset)
        self._dataset = dataset
        self._period = 1.0 / rate

    def frames(self) -> Iterator[DriveFrame]:
        """Read all frames in their order."""
        for place, number in enumerate(self._dataset.numbers, 1):
            yield DriveFrame(self._dataset.name(number), place * self._period, partial(self._read, number))

    def _read(self, number: int) -> Image | None:
        try:
            return self._dataset.read(number).image
        except TornPictureError:
            return None
