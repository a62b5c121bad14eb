"""What is judged by many combinations: a drive by name, so that every process can open it. Who answers it."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import partial
from itertools import chain
from pathlib import Path

import numpy as np

from anytraverse.assessment import Reason
from anytraverse.evaluation.datasets import Dataset, Selection, TornPictureError, open_dataset
from anytraverse.evaluation.labels import LabelClasses, Labels, fold
from anytraverse.frame import Image
from anytraverse.operations import Operation, SetWord, Tap
from anytraverse.regions import Region
from anytraverse.synonyms import meaning_of
from companion.calls.decisions import Call
from companion.calls.summary import fractions
from companion.desk.drives.desk import AnswerFile
from companion.desk.drives.drive import Drive, DriveError, DriveFrame, printable
from companion.desk.drives.frames import open_drive
from companion.desk.drives.judge import DriveJudge
from companion.desk.drives.recorded import RecordedDrive
from companion.wire.answers import Answer
from companion.wire.ids import Motion
from companion.wire.typed_answers import placed, read_typed

Operator = Callable[[DriveJudge, Call, DriveFrame], Answer]
"""Answers a call that has opened at this frame. May raise CommandError."""
Given = tuple[float, Answer]
"""An answer that somebody gave, and the seconds of the drive at which its call opened."""

LEAST_SHARE = 0.05
"""A class is named in answer to an unknown scene where it covers this share of the region of interest."""
NEAR_S = 3.0
"""A given answer also serves a call that opens by so many seconds earlier or later than the answered one."""


def go(_judge: DriveJudge, call: Call, _frame: DriveFrame) -> Answer:
    """Say that all is well."""
    return Answer(call.id, Motion.GO)


class LabelOperator:
    """Answers as somebody who sees the labels of the frame, and says go.

    It names the class that covers most of an unknown thing's tile, and of an unknown scene all classes in the
    region of interest, but none that a word in use means already. Drivable classes get the weight 1, others
    -1. A thing whose class the perceiver does not know is tapped, each time that a call asks about it.
    """

    def __init__(
        self, classes: LabelClasses, labels_of: Callable[[str], Labels], drivable: Sequence[str]
    ) -> None:
        """labels_of: returns the labels of the frame of a name, or raises DatasetError. drivable: classes."""
        self._classes = classes
        self._labels_of = labels_of
        self._drivable = frozenset(drivable)
        self._newest: tuple[str, Labels] | None = None

    @classmethod
    def of(cls, dataset: Dataset, drivable: Sequence[str]) -> LabelOperator:
        """Return one who sees the labels of a data set."""
        numbers = {dataset.name(number): number for number in dataset.numbers}
        return cls(dataset.classes, lambda name: dataset.read(numbers[name]).labels, drivable)

    def __call__(self, judge: DriveJudge, call: Call, frame: DriveFrame) -> Answer:
        """Answer a call. Raises DatasetError for labels that cannot be read."""
        labels, seen, engine = self._labels(frame.name), call.seen, judge.engine
        assert seen is not None
        shares: dict[str, float] = {}
        if Reason.UNKNOWN_SCENE in call.reasons:
            shares = self._shares(labels, engine.settings.region)
        thing = self.asked(call, frame)
        named = [name for name, share in shares.items() if share >= LEAST_SHARE]
        names = list(dict.fromkeys([*([thing] if thing else []), *named]))
        meaning = engine.perceiver.meaning
        meant = {meaning_of(word, meaning) or word for word in engine.memory.preferences}
        operations: list[Operation] = []
        for name in names:
            word, weight = fold(name), 1.0 if name in self._drivable else -1.0
            own = meaning_of(word, meaning)
            if own is None and name == thing and seen.tile is not None:
                operations.append(Tap(call.frame_id, fractions(seen.tile.shown), word, weight))
            elif own is not None and own not in meant:
                operations.append(SetWord(word, weight))
                meant.add(own)
        return Answer(call.id, Motion.GO, tuple(operations))

    def asked(self, call: Call, frame: DriveFrame) -> str | None:
        """Return the class of the unknown thing that is asked about; None without one, or without a label.

        Raises DatasetError.
        """
        if Reason.UNKNOWN_OBJECT not in call.reasons or call.seen is None or call.seen.tile is None:
            return None
        within = self._shares(self._labels(frame.name), call.seen.tile.shown)
        return max(within, key=lambda name: within[name], default=None)

    def _labels(self, name: str) -> Labels:
        """Read a frame's labels; those of the newest frame are kept for the other trials."""
        if self._newest is None or self._newest[0] != name:
            self._newest = name, self._labels_of(name)
        return self._newest[1]

    def _shares(self, labels: Labels, region: Region) -> dict[str, float]:
        """Return the share of a region that each class covers, the largest first."""
        counts = np.bincount(labels[region.mask(*labels.shape)], minlength=256)
        classes, shares = self._classes, dict[str, float]()
        for number in np.argsort(-counts, kind="stable"):
            name = classes.known.get(fold(classes.names[number])) if number < len(classes.names) else None
            if name is not None and number != classes.ignore and counts[number]:
                shares[name] = shares.get(name, 0.0) + float(counts[number] / counts.sum())
        return shares


class GivenAnswers:
    """Answers as somebody did before: with what was said to the call that opened nearest in time."""

    def __init__(self, answers: Sequence[Given]) -> None:
        self._answers = answers

    def __call__(self, judge: DriveJudge, call: Call, frame: DriveFrame) -> Answer:
        """Answer a call; a go where nothing was said near it. Raises CommandError."""
        nearest = min((at for at, _ in self._answers), key=lambda at: abs(at - frame.at), default=math.inf)
        if abs(nearest - frame.at) > NEAR_S:
            return go(judge, call, frame)
        told = judge.told(call)
        said = [placed(answer, told).operations for at, answer in self._answers if at == nearest]
        return Answer(call.id, Motion.GO, tuple(chain(*said)))


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
