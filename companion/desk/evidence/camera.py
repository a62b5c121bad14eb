"""Tells what the camera delivered, and each time that it was lost."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from itertools import pairwise
from statistics import median
from typing import NamedTuple

from companion.cameras.shown import shown
from companion.desk.evidence.drives import CameraSample
from companion.desk.evidence.parts import Basis, EvidencePart, quantile, utc
from companion.desk.evidence.sources import Sources

_RECORD = "companion config set recording.size=1000, and drive"
_GAP = 5.0
"""Seconds between two samples beyond which it is not known what the camera did."""


class CameraLoss(NamedTuple):
    """A time without a new picture. at: seconds since 1970 by when the last one had come.

    least, most: bounds of its seconds; most None where it did not end in what was recorded.
    by_vision: whether the process that reads the camera was in trouble meanwhile.
    """

    at: float
    least: float
    most: float | None
    by_vision: bool


def camera_part(sources: Sources) -> EvidencePart:
    """Describe the camera."""
    part, driven = EvidencePart("Camera"), sources.driven
    part.note = "The count of pictures is stored once a second: that bounds how long none came."
    part.tell(Basis("configuration"), ("source", shown(sources.config.camera.source), ""))
    why = driven.trouble or "nothing is recorded of it"
    if driven.camera:
        _tell_pictures(part, driven.camera, sources.config.freshness)
    else:
        part.lack("how often no picture came, and their rate while it drove", why, _RECORD)
    if driven.ages:
        basis = driven.basis(len(driven.ages))
        part.tell_spread(basis, "from capture to judged", [1e3 * one for one in driven.ages], "ms")
        part.tell(basis, ("frames that were a fault", 100.0 * driven.faulty / len(driven.ages), "%"))
    else:
        part.lack("the time from a picture's capture until it is judged", why, _RECORD)
    return part


def _tell_pictures(part: EvidencePart, samples: Sequence[CameraSample], limit: float) -> None:
    sizes = Counter(f"{one.size[0]} x {one.size[1]}" for one in samples if all(one.size))
    rates = [one.rate for one in samples if one.rate is not None]
    losses = camera_losses(samples, limit)
    part.tell(
        Basis("recordings", len(samples), samples[0].at, samples[-1].at),
        ("size", ", ".join(sizes) or None, "pixels"),
        ("frames per second, median", median(rates) if rates else None, "1/s"),
        ("frames per second, 1 %", quantile(rates, 0.01) if rates else None, "1/s"),
        (f"times without a picture for {limit:g} s", len(losses), ""),
        ("of these, with trouble of the vision process", sum(one.by_vision for one in losses), ""),
    )
    if losses:
        rows = [
            {
                "last picture by": utc(one.at),
                "back after, s, at least": one.least,
                "at most": one.most,
                "vision in trouble": one.by_vision,
            }
            for one in losses
        ]
        part.tabulate("Times without a picture", rows)


def camera_losses(samples: Sequence[CameraSample], least: float) -> list[CameraLoss]:
    """Find the times without a new picture, of at least so many seconds. samples: rising in time.

    Where the count of pictures has not risen from one sample to the next, none came between them.
    """
    found, gone, earliest = list[CameraLoss](), list[CameraSample](), 0.0

    def lost(until: float | None) -> None:
        if gone and gone[-1].at - gone[0].at >= least:
            most = None if until is None else until - earliest
            by_vision = any(one.trouble for one in gone[1:])
            found.append(CameraLoss(gone[0].at, gone[-1].at - gone[0].at, most, by_vision))
        gone.clear()

    known = samples[0].at if samples else 0.0
    for before, one in pairwise(samples):
        if one.pid != before.pid or one.at - before.at > _GAP:
            lost(None)
        elif one.read > (before.read if one.read >= before.read else 0):
            lost(one.at)
        else:
            earliest = earliest if gone else known
            gone += [one] if gone else [before, one]
        known = before.at
    lost(None)
    return found
