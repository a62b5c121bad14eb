"""Taps pasted things when they are first called for, drives on, and looks what else is taken for them.

A tapped thing that is not covered calls again. A thing that is taken for the tapped one holds the rover under
its name, and nobody is asked what it is.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from anytraverse.assessment import Reason
from anytraverse.engine import AnyTraverse
from anytraverse.errors import ExampleError
from anytraverse.frame import Image
from anytraverse.perception import Example
from anytraverse.preferences import Preferences
from anytraverse.regions import Box
from bench.perception.approaches import ASIDE, DISTANCES, backgrounds
from bench.perception.figures import Figure, share
from bench.perception.frames import Frames
from bench.perception.judged import ROVER, Judge
from bench.perception.pasting import Cutout, paste, pasted_box
from bench.perception.things import KINDS

COUNT = 8
"""Approaches for each place and kind."""
TAPPED = (
    "a tapped thing: frames after its first tap that do not call again",
    "a tapped thing: one tap was enough",
    "another thing, 4.5 m ahead, is taken for the tapped one",
    "a clean frame is not OK beside a tapped word",
)
"""What is counted."""
_NAME = "tapped thing"
_GROWN = 1.3
"""Size of the box that is tapped over the size of the thing."""
_MOST = 4
"""Taps of one thing: then the operator has better things to do."""
_OTHERS = 3
_OTHER_AT = 4.5
"""Metres at which other things stand."""


def measure_taps(
    judge: Judge, frames: Frames, cutouts: dict[str, list[Cutout]], seed: int
) -> dict[str, Figure]:
    """Count how often a tapped thing is covered, how often it is tapped, and what else is taken for it."""
    found: dict[str, Figure] = {}
    for place, sets in (("home", frames.home), ("abroad", frames.abroad)):
        clean = [
            one.image for one in backgrounds(sets, 4 * COUNT) if judge.see_briefly(one.image, keep=False).ok
        ]
        tally = _Tally(judge, cutouts, clean[:COUNT])
        for number, kind in enumerate(KINDS):
            rng = np.random.default_rng([seed, 8, number, place == "home"])
            for index, image in enumerate(tally.clean if cutouts[kind] else ()):
                tally.drive(image, kind, index, float(rng.uniform(-ASIDE, ASIDE)), rng)
        found |= {f"{what}: {place}": share(each) for what, each in tally.counted.items()}
    return found


class _Tally:
    """Drives approaches over clean frames, and counts what taps do."""

    def __init__(self, judge: Judge, cutouts: dict[str, list[Cutout]], clean: Sequence[Image]) -> None:
        self.clean = clean
        self._judge = judge
        self._cutouts = cutouts
        self.counted: dict[str, list[bool]] = {name: [] for name in TAPPED}

    def drive(self, image: Image, kind: str, index: int, aside: float, rng: np.random.Generator) -> None:
        """Drive up to a thing, tap it whenever it calls, and then show other things and a clean frame."""
        thing = self._cutouts[kind][index % len(self._cutouts[kind])]
        examples: list[Example] = []
        covered, once, other, stopped = self.counted.values()
        for distance in DISTANCES:
            view = paste(image, thing, distance, aside)
            calls = self._calls(view, examples)
            if calls and len(examples) < _MOST:
                examples += self._tapped(view, pasted_box(view.shape, thing, distance, aside))
                calls = self._calls(view, examples)
            if examples:
                covered.append(not calls)
        if not examples:
            return
        once.append(len(examples) == 1)
        for _ in range(_OTHERS):
            name = str(rng.choice([each for each in KINDS if each != kind and self._cutouts[each]]))
            another = self._cutouts[name][int(rng.integers(len(self._cutouts[name])))]
            view = paste(self.clean[int(rng.integers(len(self.clean)))], another, _OTHER_AT, aside)
            if self._calls(view, []):
                other.append(not self._calls(view, examples))
        stopped.append(not self._with(examples).see(self.clean[int(rng.integers(len(self.clean)))]).ok)

    def _calls(self, view: Image, examples: Sequence[Example]) -> bool:
        return Reason.UNKNOWN_OBJECT in self._with(examples).see(view).reasons

    def _with(self, examples: Sequence[Example]) -> Judge:
        engine = self._judge.engine
        if not examples:
            return self._judge
        words = Preferences.parse(f"{ROVER}; {_NAME}: -1")
        memory = engine.memory.using(words, {_NAME: tuple(examples)})
        return Judge(AnyTraverse(engine.perceiver, engine.settings, memory))

    def _tapped(self, view: Image, box: Box) -> list[Example]:
        perceiver = self._judge.engine.perceiver
        try:
            return [perceiver.example(perceiver.encode(view), box.grown(_GROWN))]
        except ExampleError:
            return []
