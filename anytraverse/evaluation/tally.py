"""Counts the pixels of a frame by class and by what the maps say: all that any figure of a run is made of."""

from __future__ import annotations

import struct
import zlib
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from anytraverse.errors import AnyTraverseError
from anytraverse.evaluation.datasets import LabelledFrame
from anytraverse.evaluation.labels import LabelClasses, fold
from anytraverse.evaluation.scores import COARSE, Counts
from anytraverse.evaluation.seeing import TimedMaps, stretched, stretched_mask
from anytraverse.judging import Settings

THRESHOLDS = tuple(step / 20 for step in range(1, 20))
"""Traversabilities above which a pixel may count as drivable, rising."""
HALF = THRESHOLDS.index(0.5)
_LEVELS = np.array(THRESHOLDS, dtype=np.float32)
REGION = Settings().region
"""The region of interest that a rover has by default."""
_MEASURED = struct.Struct("<dd")
FORMAT = 1
"""Rises when a tally of before means something else."""


class DamagedTallyError(AnyTraverseError):
    """Reports a stored tally that is not whole."""


@dataclass(frozen=True)
class Rows:
    """Assigns a row of counts to each class; the last row is for pixels without a label."""

    classes: LabelClasses

    @property
    def names(self) -> tuple[str, ...]:
        """The names of the classes, without the last row."""
        return tuple(self.classes.known.values())

    @property
    def count(self) -> int:
        """The number of rows."""
        return len(self.names) + 1

    def table(self) -> NDArray[np.int64]:
        """Return the row of each id, (256,)."""
        folded = {name: row for row, name in enumerate(self.classes.known)}
        rows = np.full(256, len(folded), dtype=np.int64)
        for number, name in enumerate(self.classes.names):
            if number != self.classes.ignore:
                rows[number] = folded.get(fold(name), len(folded))
        return rows


@dataclass(frozen=True, eq=False)
class Tally:
    """Holds the counts of a frame, for each row of `Rows`.

    ground: (rows, thresholds + 1), by how many of `THRESHOLDS` the traversability is above.
    known: (rows, 2), pixels that `Maps.drivable` leaves out, and that it marks.
    uncertainty: (rows, `COARSE.count`), by the uncertainty's bin. roi: (rows,), pixels in the region of
    interest. roi_uncertainty: its mean there, as the rover judges. milliseconds: what judging took.
    """

    ground: Counts
    known: Counts
    uncertainty: Counts
    roi: Counts
    roi_uncertainty: float
    milliseconds: float

    @classmethod
    def of(cls, seen: TimedMaps, frame: LabelledFrame, rows: Rows) -> Tally:
        """Count a frame at its labels' size."""
        shape = frame.labels.shape
        row = rows.table()[frame.labels]
        trav = stretched(seen.maps.traversability, shape)
        return cls(
            _counted(row, np.searchsorted(_LEVELS, trav), rows.count, len(THRESHOLDS) + 1),
            _counted(row, stretched_mask(seen.maps.drivable, shape).astype(np.int64), rows.count, 2),
            _counted(row, COARSE.of(stretched(seen.maps.uncertainty, shape)), rows.count, COARSE.count),
            np.bincount(row[REGION.mask(*shape)], minlength=rows.count),
            float(seen.maps.uncertainty[REGION.mask(*seen.maps.uncertainty.shape)].mean()),
            seen.milliseconds,
        )

    def packed(self) -> bytes:
        """Return the counts as bytes that `unpacked` reads."""
        parts = (self.ground, self.known, self.uncertainty, self.roi)
        counts = b"".join(part.astype("<u4").tobytes() for part in parts)
        return zlib.compress(_MEASURED.pack(self.roi_uncertainty, self.milliseconds) + counts, 1)

    @classmethod
    def unpacked(cls, packed: bytes, rows: int) -> Tally:
        """Read what `packed` returned for so many rows. Raises DamagedTallyError."""
        widths = len(THRESHOLDS) + 1, 2, COARSE.count, 1
        try:
            whole = zlib.decompress(packed)
            roi_uncertainty, milliseconds = _MEASURED.unpack_from(whole)
            counts = np.frombuffer(whole, "<u4", offset=_MEASURED.size).astype(np.int64)
            ends = np.cumsum([rows * width for width in widths])
            if len(counts) != ends[-1]:
                raise ValueError("too long or too short")
        except (zlib.error, struct.error, ValueError) as error:
            raise DamagedTallyError(f"a stored tally is damaged: {error}") from error
        parts = np.split(counts, ends[:-1])
        ground, known, uncertainty, roi = (
            part.reshape(rows, width) for part, width in zip(parts, widths, strict=True)
        )
        return cls(ground, known, uncertainty, roi[:, 0], roi_uncertainty, milliseconds)


def _counted(row: Counts, column: Counts, rows: int, columns: int) -> Counts:
    """Count the pixels of each row and column, (rows, columns)."""
    places = (row * columns + column).ravel()
    return np.bincount(places, minlength=rows * columns).reshape(rows, columns)
