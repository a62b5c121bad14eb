"""Judges the frames of a data set one by one, with one set of words or several, and none of them twice."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from threading import local

from anytraverse.errors import PerceiverError
from anytraverse.evaluation.datasets import Dataset, FrameFiles, LabelledFrame, TornPictureError, open_dataset
from anytraverse.evaluation.labels import DatasetError
from anytraverse.evaluation.progress import Progress
from anytraverse.evaluation.records import TallyStore
from anytraverse.evaluation.seeing import PerceiverRun, maps_identity
from anytraverse.evaluation.spreading import spread
from anytraverse.evaluation.tally import Rows, Tally
from anytraverse.perception import Features, make_perceiver
from anytraverse.perception.runtime import Runtime
from anytraverse.preferences import Preferences

_AT_ONCE = 16
"""Frames that a worker of a cluster judges before it says so."""
Judged = tuple[int, tuple[Tally, ...]]
"""A frame's number, and its tally with each set of words."""


@dataclass(frozen=True)
class WorkShare:
    """Names frames and all that a worker needs to judge them: folder, perceiver, words as text.

    model: `maps_identity` of the perceiver, which a worker's must have, too.
    """

    folder: str
    split: str
    perceiver: str
    model: str
    threads: int
    prompts: tuple[str, ...]
    numbers: tuple[int, ...] = ()


class Evaluation:
    """Iterates over the chosen frames, in order, and shows the progress on stderr.

    A frame is encoded once for all sets of words, and not judged with words for which its tally is stored.
    resumed: how many frames need no judging. torn: the number of frames that could not be read; a later run
    tries them again.
    """

    def __init__(self, dataset: Dataset, runs: Sequence[PerceiverRun], records: TallyStore) -> None:
        """runs: of one perceiver, at most `records.MOST_WORDS`."""
        self._dataset = dataset
        self._runs = runs
        self._records = records
        self._rows = Rows(dataset.classes)
        self._keys = [records.use(run.words) for run in runs]
        self.torn = 0
        self._left = {
            number: files
            for number, files in zip(dataset.numbers, dataset.files, strict=True)
            if not all(records.holds(key, dataset.name(number), files) for key in self._keys)
        }
        """The frames that were not judged before."""
        self.resumed = len(dataset) - len(self._left)

    def __iter__(self) -> Iterator[Judged]:
        """Raises DatasetError when every frame is damaged or records cannot be written; PerceiverError."""
        with Progress(len(self._dataset) - self.resumed, "frames") as progress:
            if self.resumed:
                progress.say(f"{self.resumed} frames were judged before and are not judged again")
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
        if self.torn == len(self._dataset):
            raise DatasetError(f"{self._dataset.path} has no frame that can be read: copy the folder again")

    def on_cluster(self, share: WorkShare, address: str) -> None:
        """Judge the frames that are not stored on a Dask cluster, and store them.

        share: of this data set and these runs, without numbers. Damaged frames are left for the iteration.
        Raises SpreadError, DatasetError.
        """
        left = list(self._left)
        shares = [
            replace(share, numbers=tuple(left[at : at + _AT_ONCE])) for at in range(0, len(left), _AT_ONCE)
        ]

        def store(_number: int, found: list[tuple[int, tuple[bytes, ...]]]) -> None:
            for number, packed in found:
                for key, tally in zip(self._keys, packed, strict=True):
                    unpacked = Tally.unpacked(tally, self._rows.count)
                    self._records.add(key, self._dataset.name(number), self._left[number], unpacked)
            progress.step(len(found))

        with Progress(len(left), "frames on the cluster") as progress:
            spread(judged_share, shares, dask=address, done=store)
        self.resumed = len(self._dataset)

    def _judged(self, number: int, files: FrameFiles, stored: Sequence[Tally | None]) -> tuple[Tally, ...]:
        """Return a frame's tallies, and store those that were not."""
        frame = self._dataset.read(number)
        features = _shared_features(self._runs, frame)
        tallies = []
        for key, run, known in zip(self._keys, self._runs, stored, strict=True):
            tally = known or Tally.of(run.look(frame, features), frame, self._rows)
            if known is None:
                self._records.add(key, self._dataset.name(number), files, tally)
            tallies.append(tally)
        return tuple(tallies)


def _shared_features(runs: Sequence[PerceiverRun], frame: LabelledFrame) -> Features | None:
    """Encode a frame once for several sets of words; None for a single one, which encodes it itself."""
    return runs[0].perceiver.encode(frame.image) if len(runs) > 1 else None


def judged_share(share: WorkShare) -> list[tuple[int, tuple[bytes, ...]]]:
    """Judge frames in a worker of a cluster. Return their numbers and packed tallies, one for each prompt.

    Raises DatasetError, PerceiverError, PreferencesError.
    """
    dataset, runs = _opened(replace(share, numbers=()))
    rows, found = Rows(dataset.classes), []
    for number in share.numbers:
        try:
            frame = dataset.read(number)
        except TornPictureError:
            continue
        features = _shared_features(runs, frame)
        tallies = (Tally.of(run.look(frame, features), frame, rows) for run in runs)
        found.append((number, tuple(tally.packed() for tally in tallies)))
    return found


class _Opened(local):
    """What this thread has opened last, for its next share: a perceiver serves one thread."""

    share: WorkShare | None = None
    dataset: Dataset
    runs: tuple[PerceiverRun, ...]


_OPENED = _Opened()


def _opened(share: WorkShare) -> tuple[Dataset, tuple[PerceiverRun, ...]]:
    """Open data set and perceiver, or return those of this thread. Raises as `judged_share` does."""
    if _OPENED.share != share:
        perceiver = make_perceiver(share.perceiver, Runtime(threads=share.threads))
        own = maps_identity(share.perceiver, perceiver)
        if own != share.model:
            raise PerceiverError(f"a worker has {own}, not {share.model}: give it the same package and files")
        _OPENED.runs = tuple(PerceiverRun(perceiver, Preferences.parse(one)) for one in share.prompts)
        _OPENED.dataset, _OPENED.share = open_dataset(share.folder, share.split), share
    return _OPENED.dataset, _OPENED.runs
