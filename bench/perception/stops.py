"""Counts clean frames that are not OK, and real things that are noticed."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

from anytraverse.assessment import Assessment, Reason
from bench.perception.figures import Figure, share
from bench.perception.frames import PLANTS, Frames, LabelledSet, spread
from bench.perception.judged import Judge

LEAST = 0.02
"""Of the region of interest: a smaller thing need not be noticed."""
TRAINED = "home, drives that the shipped network was trained on"
_MOST = 200
"""Clean frames of these drives, spread over them."""


def clean_frames(judge: Judge, frames: Frames) -> dict[str, list[Assessment]]:
    """Judge the clean frames of every place."""
    trained = frames.trained.clean
    return {
        "home": [judge.see(frame.image) for one in frames.home for frame in one.clean],
        "abroad": [judge.see(frame.image) for one in frames.abroad for frame in one.clean],
        TRAINED: [judge.see(trained[i].image) for i in spread(len(trained), _MOST)],
        "sequence of another vehicle, no labels": judge.see_all(frames.clean),
    }


def measure_stops(clean: dict[str, list[Assessment]]) -> dict[str, Figure]:
    """Count clean frames that are not OK, in all and by what was found."""
    found = {}
    for place, judged in clean.items():
        found[f"clean frames stopped: {place}"] = share([not one.ok for one in judged])
        figures = Counter(
            f"{finding.reason.value}, {finding.figure}" for one in judged for finding in set(one.bad)
        )
        for name, _ in figures.most_common():
            hits = [any(f"{f.reason.value}, {f.figure}" == name for f in one.bad) for one in judged]
            found[f"  {place}, by {name}"] = share(hits)
    return found


def frames_with(sets: Sequence[LabelledSet], ids_of: str) -> list[tuple[LabelledSet, int]]:
    """Return (set, index of its frame) where things, or plants, fill over `LEAST` of the ROI."""
    found = []
    for one in sets:
        ids = one.things if ids_of == "things" else one.ids(PLANTS)
        found += [(one, i) for i, frame in enumerate(one.frames) if one.roi_share(frame, ids) > LEAST]
    return found


def measure_things(judge: Judge, frames: Frames) -> dict[str, Figure]:
    """Count the frames abroad with real things, or plants, in the ROI that are not OK."""
    found = {}
    for kind in ("things", "plants"):
        judged = [judge.see(one.frames[i].image) for one, i in frames_with(frames.abroad, kind)]
        names = f"real {kind} over {LEAST:.0%} of the ROI, abroad"
        found[f"{names}: not OK"] = share([not one.ok for one in judged])
        for reason in (Reason.UNKNOWN_OBJECT, Reason.BLOCKED):
            found[f"{names}: {reason.value}"] = share([reason in one.reasons for one in judged])
    return found
