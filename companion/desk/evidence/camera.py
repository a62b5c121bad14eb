"""Tells what the camera delivered, and each time that it was lost."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from statistics import median
from typing import NamedTuple

from companion.cameras.newest import CameraState
from companion.cameras.shown import shown
from companion.desk.evidence.drives import CameraSample
from companion.desk.evidence.parts import (
    Basis,
    EvidencePart,
    EvidenceTable,
    NotKnown,
    figures,
    share,
    spread,
    utc,
)
from companion.desk.evidence.sources import Sources
from companion.vision.exposure import DARK
from companion.wire.json_values import number_of, text_of

_DELIVERING = CameraState.DELIVERING.value
_GAP = 5.0
"""Seconds between two samples beyond which it is not known what the camera did."""


class CameraLoss(NamedTuple):
    """A time without pictures. at: seconds since 1970 of the last sample with pictures.

    least, most: bounds of its seconds, None where it did not end in what was recorded.
    """

    at: float
    least: float | None
    most: float | None


def camera_part(sources: Sources) -> EvidencePart:
    """Describe the camera."""
    driven, camera = sources.driven, sources.config.camera
    found = figures(
        Basis("configuration"),
        (
            ("source", shown(camera.source), ""),
            ("frames per second that it aims to judge", camera.rate, "1/s"),
            ("horizontal field of view", camera.view, "°"),
        ),
    )
    unknown = list[NotKnown]()
    tables: tuple[EvidenceTable, ...] = ()
    if samples := driven.camera:
        over = Basis("recordings", len(samples), samples[0].at, samples[-1].at)
        sizes = Counter(f"{one.size[0]} x {one.size[1]}" for one in samples if all(one.size))
        rates = [one.rate for one in samples if one.rate is not None and one.state == _DELIVERING]
        losses = camera_losses(samples)
        found += figures(
            over,
            (
                ("size", ", ".join(sizes) or None, "pixels"),
                ("frames per second, median", median(rates) if rates else None, "1/s"),
                ("frames per second, 1 %", share(rates, 0.01) if rates else None, "1/s"),
                ("times that it was lost", len(losses), ""),
            ),
        )
        if losses:
            rows = [(utc(one.at), one.least, one.most) for one in losses]
            tables = (
                EvidenceTable.of(
                    "Camera lost", ("last seen delivering", "back after, s, at least", "at most"), rows
                ),
            )
    elif sources.status:
        told = sources.told("camera")
        once = Basis("status.json", None, sources.written, sources.written)
        size = f"{told.get('width')} x {told.get('height')}" if told.get("width") else None
        rate = number_of(told.get("rate"), 0.0, 1e4)
        found += figures(
            once,
            (
                ("size", size, "pixels"),
                ("frames per second", rate, "1/s"),
                ("state", text_of(told.get("state")), ""),
            ),
        )
    if not driven.camera:
        unknown.append(_not_recorded(sources, "how often the camera was lost, and its rate while it drove"))
    if driven.ages:
        over = Basis("recordings", len(driven.ages), driven.judged[0], driven.judged[-1])
        found += spread("from capture to judged", [1e3 * one for one in driven.ages], "ms", over)
        faulty = 100.0 * sum(driven.faulty) / len(driven.faulty)
        found += figures(over, [("frames that were a fault", faulty, "%")])
    else:
        unknown.append(_not_recorded(sources, "the time from a picture's capture until it is judged"))
    if driven.light:
        levels = [level for _, level in driven.light]
        over = Basis("recordings, one frame each", len(levels), driven.light[0][0], driven.light[-1][0])
        dark = sum(level < DARK for level in levels)
        found += figures(
            over,
            (
                ("brightness, of 255, darkest", min(levels), ""),
                ("brightness, median", median(levels), ""),
                ("brightness, brightest", max(levels), ""),
                (f"frames darker than {DARK:g}", dark, ""),
            ),
        )
    else:
        unknown.append(_not_recorded(sources, "the light in which it drove"))
    note = "The camera's state is sampled once a second: that bounds how long it was lost."
    return EvidencePart("camera", "Camera", found, tables, tuple(unknown), note)


def camera_losses(samples: Sequence[CameraSample]) -> list[CameraLoss]:
    """Find the times without pictures between samples that rise in time."""
    found, last, lost = list[CameraLoss](), None, None
    for one in samples:
        here = one.state == _DELIVERING
        if last is not None and (one.at - last.at > _GAP or one.pid != last.pid):
            if lost is not None:
                found.append(CameraLoss(lost[0], None, None))
            lost = None
        elif last is not None and last.state == _DELIVERING and not here:
            lost = last.at, one.at
        elif last is not None and lost is not None and here:
            found.append(CameraLoss(lost[0], last.at - lost[1], one.at - lost[0]))
            lost = None
        last = one
    return found if lost is None else [*found, CameraLoss(lost[0], None, None)]


def _not_recorded(sources: Sources, what: str) -> NotKnown:
    why = sources.driven.trouble or "nothing is recorded of it"
    return NotKnown(what, why, "companion config set recording.size=1000, and drive")
