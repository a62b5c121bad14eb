"""Drives up to pasted things: whether, and from how far, they are noticed before the stopping distance."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field

import numpy as np

from anytraverse.assessment import Assessment, Observation
from anytraverse.evaluation.datasets import LabelledFrame
from anytraverse.frame import Image
from bench.perception.figures import Figure, share
from bench.perception.frames import Frames, LabelledSet, spread
from bench.perception.judged import Judge
from bench.perception.pasting import Cutout, covered, paste
from bench.perception.things import ACROSS, KINDS, LARGE, OTHER, SMALL

FARTHEST, NEAREST, STEPS = 10.0, 2.8, 9
"""Metres of the first and the last frame, and how many there are.

A rover that is commanded 1 m/s drives up to 1.12 m/s. From 2.8 m it stops in front of a thing: 0.4 s after
the second frame it brakes, and braking takes 2.1 s times its speed.
"""
DISTANCES = tuple(float(d) for d in np.geomspace(FARTHEST, NEAREST, STEPS))
ASIDE = 0.25
"""Metres to either side, at most, by which a thing stands beside the middle."""
VOTES, WINDOW = 2, 3


@dataclass(eq=False)
class Approach:
    """Holds one approach: what the clean frame was judged, and what each frame with the thing.

    covered: the share of the region of interest that the thing's box covers in each frame.
    """

    place: str
    kind: str
    source: str
    clean: Assessment
    frames: list[Assessment] = field(default_factory=list)
    covered: list[float] = field(default_factory=list)

    def noticed_at(self, ok: Callable[[Observation], bool] | None = None) -> float | None:
        """Return the distance at which 2 of 3 frames in a row were not OK; None: never.

        ok: judges a frame again; None: as it was judged.
        """
        bad: list[bool] = []
        for distance, frame in zip(DISTANCES, self.frames, strict=False):
            bad.append(not _ok(frame, ok))
            if sum(bad[-WINDOW:]) >= VOTES:
                return distance
        return None

    def counts(self, ok: Callable[[Observation], bool] | None = None) -> bool:
        """Return whether the clean frame is OK, so that what is noticed is the thing."""
        return _ok(self.clean, ok)


def _ok(judged: Assessment, ok: Callable[[Observation], bool] | None) -> bool:
    if ok is None:
        return judged.ok
    assert judged.observation is not None
    return ok(judged.observation)


def approaches(
    judge: Judge, frames: Frames, cutouts: dict[str, list[Cutout]], count: int, seed: int, *, whole: bool
) -> Iterator[Approach]:
    """Drive `count` approaches for each place and kind that has cut-outs, over clean frames in turn.

    whole: with every frame, and over clean frames that are not OK, too, for judging again with other
    settings. Otherwise an approach ends when its thing is noticed.
    """
    for place, sets in (("home", frames.home), ("abroad", frames.abroad)):
        clean = [
            (frame.image, judge.see_briefly(frame.image, keep=whole)) for frame in backgrounds(sets, count)
        ]
        clean = [(image, judged) for image, judged in clean if whole or judged.ok]
        if not clean:
            continue
        for number, kind in enumerate(KINDS):
            rng = np.random.default_rng([seed, 4, number, place == "home"])
            pictures = cutouts[kind]
            order = rng.permutation(len(clean))
            for index in range(count if pictures else 0):
                image, judged = clean[order[index % len(clean)]]
                thing = pictures[index % len(pictures)]
                approach = Approach(place, kind, thing.source, judged)
                _drive(judge, approach, image, thing, float(rng.uniform(-ASIDE, ASIDE)), whole)
                yield approach


def _drive(judge: Judge, approach: Approach, image: Image, thing: Cutout, aside: float, whole: bool) -> None:
    for distance in DISTANCES:
        approach.frames.append(judge.see_briefly(paste(image, thing, distance, aside), keep=whole))
        bounds = judge.settings.region.bounds
        approach.covered.append(covered(image.shape, thing, distance, aside, bounds))
        if not whole and approach.noticed_at() is not None:
            return


def backgrounds(sets: Sequence[LabelledSet], most: int) -> list[LabelledFrame]:
    """Return at most so many clean frames, spread over all."""
    clean = [frame for one in sets for frame in one.clean]
    return [clean[index] for index in spread(len(clean), most)]


def measure_approaches(driven: Sequence[Approach]) -> dict[str, Figure]:
    """Count what was never noticed, by place and group, by kind and by source."""
    found: dict[str, Figure] = {}
    for group in (LARGE, SMALL, OTHER, ACROSS):
        kinds = [kind for kind in KINDS if KINDS[kind].group == group]
        for place in ("home", "abroad"):
            own = [one for one in driven if one.kind in kinds and one.place == place]
            found[f"never noticed, {place}: {group}"] = _missed(own)
            for kind in kinds:
                some = [one for one in own if one.kind == kind]
                found[f"  {place}, {kind}"] = _missed(some)
                several = dict.fromkeys(one.source for one in some)
                for source in several if len(several) > 1 else ():
                    few = [one for one in some if one.source == source]
                    found[f"  {place}, {kind}, {source}"] = _missed(few)
    return found


def missed(driven: Sequence[Approach], group: str) -> Figure:
    """Count what was never noticed of a group, at home and abroad together."""
    return _missed([one for one in driven if KINDS[one.kind].group == group])


def sources(driven: Sequence[Approach]) -> dict[str, tuple[str, ...]]:
    """Return for each kind where its cut-outs are from."""
    return {
        kind: tuple(dict.fromkeys(one.source for one in driven if one.kind == kind))
        for kind in dict.fromkeys(one.kind for one in driven)
    }


def first_seen(driven: Sequence[Approach]) -> dict[str, dict[str, int]]:
    """Return for each place and kind how many were first noticed at each distance, or never."""
    table: dict[str, dict[str, int]] = {}
    for one in driven:
        at = one.noticed_at()
        row = table.setdefault(f"{one.place}, {one.kind}", {})
        name = "never" if at is None else f"{at:.1f} m"
        row[name] = row.get(name, 0) + 1
    return table


def _missed(driven: Sequence[Approach]) -> Figure:
    return share([one.noticed_at() is None for one in driven if one.counts()])
