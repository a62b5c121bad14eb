"""Compares what the vision process found in a frame with the figures that it reports of the frame."""

from __future__ import annotations

import math

import numpy as np

from anytraverse.assessment import Assessment, Finding, Maps, Reason
from anytraverse.findings import find
from anytraverse.judging import Settings
from anytraverse.roi import RoiFigures


def contradiction(seen: Assessment, settings: Settings) -> str:
    """Return what the findings or figures of a frame contradict, "" for nothing.

    settings: those by which it was judged. The findings are computed again, so that no frame is OK without
    the figures that make it OK. A further fault needs no figure: it only makes the frame worse.
    """
    faults = [finding for finding in seen.findings if finding.reason is Reason.FAULT]
    if not all(finding.bad for finding in faults):
        return "a fault that is not bad"
    if seen.roi is None:
        return "" if faults else "neither figures nor a fault"
    if seen.maps is None:
        return "figures without maps"
    told = [finding for finding in seen.findings if finding.reason is not Reason.FAULT]
    scene = next((finding for finding in told if finding.reason is Reason.UNKNOWN_SCENE), None)
    # Its value may differ: familiar surroundings are more similar, foreign ones less (see `History`).
    if (scene is None) != (seen.similarity is None) and not (scene is None and faults):
        return "a scene's finding without its similarity"
    computed = find(seen.roi, len(seen.words), None if scene is None else scene.value, settings)
    if list(map(_comparable, told)) != [
        _comparable(one) for one in computed if one.reason is not Reason.FAULT
    ]:
        return "findings that do not follow from its figures"
    return _in_figures(seen, seen.maps, seen.roi, settings)


def _in_figures(seen: Assessment, maps: Maps, roi: RoiFigures, settings: Settings) -> str:
    weights = np.asarray(list(seen.words.values()), dtype=np.float32)
    if not np.array_equal(maps.named, weights <= 0):
        return "maps of other words"
    if (roi.drivable_share is None) != (roi.known_share == 0.0):
        return "a drivable share of nothing that is known"
    judged_by = settings.at(seen.frame.lean, seen.frame.reach)
    rows, columns = judged_by.region.bounds.slices(*maps.drivable.shape)
    if roi.corridor.open and not (roi.drivable_share and maps.drivable[rows, columns].any()):
        return "an open corridor without drivable ground"
    named, limit = roi.named_tile, settings.thresholds.tile
    if named is not None:
        return "" if named.word < len(weights) and maps.named[named.word] else "a named tile without its word"
    # Outside of a worst tile that calls there may be no other tile.
    calls = limit is not None and roi.worst_tile.uncertainty > limit
    return "no tile for the words that say what is not drivable" if maps.named.any() and not calls else ""


def _comparable(finding: Finding) -> tuple[object, ...]:
    figures = (finding.value, finding.threshold)
    numbers = tuple(None if math.isnan(one) else one for one in figures)
    return finding.reason, finding.figure, finding.bad, finding.clear, *numbers
