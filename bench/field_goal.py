"""Tests whether the built-in perceiver calls for every thing on simulated trails, and for little else.

It drives two laps a seed at 2.5 m/s and 10 frames/s in changing light, and calls as the daemon does. An
operator names each place, taps each thing that is called for and removes it. A thing is missed when the rover
reaches it. A call is false on familiar trail, more than 10 m from a thing and from a change of scene. With
--teach, the operator answers a false call with a tap of that word and weight 1.
Run: python -m bench.field_goal [--perceiver builtin] [--seeds 1 2 3] [--size 320x240] [--teach tuft]
The last line is one JSON object.
"""

from __future__ import annotations

import argparse
import json
import math
from dataclasses import astuple, dataclass, field, replace
from itertools import starmap

import cv2

from anytraverse.assessment import Assessment, Reason
from anytraverse.engine import AnyTraverse
from anytraverse.frame import Frame
from anytraverse.judging import Settings
from anytraverse.memory import first_memory
from anytraverse.operations import Operation, SetWord, Tap
from anytraverse.perception import Perceiver, make_perceiver
from anytraverse.perception.runtime import Runtime
from anytraverse.preferences import Preferences
from anytraverse.regions import Box
from anytraverse.roi import Corridor
from companion.calls.numbers import Numbers
from companion.calls.reason_filter import CALLS_FOR_WORDS, ReasonFilter
from companion.sim.field.render import PinholeCamera
from companion.sim.field.things import DEFAULT_SURPRISES, FieldThing, World

SPEED = 2.5  # m/s
STEP = SPEED / 10  # m between two frames
LAPS = 2
FAMILIAR = 10.0  # m
REACHED = 0.8  # m from the rover's middle to a thing's, along the trail
NEAR = 7.0  # m, within which a call is about the thing
REGION = Box(0.35, 0.5, 0.65, 0.95)  # of a fast rover, as in the demo
WORDS = {
    "meadow": "grass: 1; dirt path: 1; sky: -0.5; bush: -1; tree: -1",
    "forest": "grass: 1; dirt path: 1; sky: -0.5; bush: -1; tree: -1",
    "gravel": "grass: 1; dirt path: 1; sky: -0.5; bush: -1; tree: -1; gravel: 1; dry grass: 0.5",
}


@dataclass
class _Tally:
    """called: kind and metres left of each thing that was called for. blocked: of each that was taken for one
    named before and not drivable, which holds the rover too. false: where, and why. taught: taps on nothing.
    """

    called: list[tuple[str, float]] = field(default_factory=list)
    blocked: list[tuple[str, float]] = field(default_factory=list)
    missed: list[str] = field(default_factory=list)
    false: list[str] = field(default_factory=list)
    places: int = 0
    taught: int = 0
    familiar: int = 0
    frames: int = 0


class _Drive:
    """Drives one seed's laps. Each kind of thing lies in another zone from seed to seed."""

    def __init__(self, perceiver: Perceiver, seed: int, size: tuple[int, int], teach: str = "") -> None:
        turn = seed % len(DEFAULT_SURPRISES)
        self.world = World(seed, DEFAULT_SURPRISES[turn:] + DEFAULT_SURPRISES[:turn])
        self.camera = PinholeCamera(self.world, *size)
        self.engine: AnyTraverse = engine_of(perceiver, WORDS["meadow"])
        self.tally = _Tally()
        self._reasons = ReasonFilter(Numbers(judging=self.engine.settings), 0.0)
        self._blocked: list[bool] = []
        self._calls = 0
        self._teach = teach

    def run(self) -> _Tally:
        """Drives all laps."""
        trail, travelled = self.world.trail, 0.0
        while travelled < LAPS * trail.length:
            self._frame((trail.start + travelled) % trail.length, travelled / SPEED)
            travelled += STEP
        return self.tally

    def _frame(self, s: float, now: float) -> None:
        self.world.light = 1 + 0.4 * math.sin(now / 7)
        self.tally.frames += 1
        familiar = self._is_familiar(s)
        self.tally.familiar += familiar
        image, _ = self.camera.render(self.world.trail.pose(s), now)
        judged = self.engine.step(Frame(self.tally.frames, now, image), now)
        self._reasons.add_frame(judged, now, None)
        ahead = self._ahead(s)
        if self._reasons.reasons(now) & CALLS_FOR_WORDS:
            self._call(judged, s, now, ahead, familiar=familiar)
        self._blocked.append(Reason.BLOCKED in judged.reasons)
        if sum(self._blocked[-3:]) >= 2 and self._blocked[-1]:
            self._hold(s, ahead, familiar=familiar)
        if ahead is not None and self._left(ahead, s) <= REACHED and ahead.id in self.world.things:
            self.tally.missed.append(ahead.kind)
            self.world.remove(ahead.id)

    def _call(
        self, judged: Assessment, s: float, now: float, ahead: FieldThing | None, *, familiar: bool
    ) -> None:
        left = self._left(ahead, s) if ahead is not None else math.inf
        asked = Reason.UNKNOWN_OBJECT in judged.reasons  # else the tile shows nothing that a tap could name
        operations: tuple[Operation, ...]
        if ahead is not None and left < NEAR and judged.tile and asked:
            operations = (Tap(judged.frame.id, astuple(judged.tile.shown), ahead.kind, -1.0),)
            self.tally.called.append((ahead.kind, round(left, 1)))
            self.world.remove(ahead.id)
        elif self._teach and judged.tile and Reason.UNKNOWN_SCENE not in judged.reasons:
            operations = (Tap(judged.frame.id, astuple(judged.tile.shown), self._teach, 1.0),)
            self.tally.taught += 1
        else:
            words = Preferences.parse(WORDS[self.world.trail.zone(s + 4.0)])
            operations = tuple(starmap(SetWord, words.items()))
            self.tally.places += 1
        if familiar:
            why = "+".join(sorted(reason.value for reason in judged.reasons & CALLS_FOR_WORDS))
            self.tally.false.append(f"{self.world.trail.zone(s)} {s:.0f} m {why}")
        self._calls += 1
        self.engine.answer(operations, now, call=judged.observation, call_id=self._calls, go=True)
        self._reasons.restart_after_answer(now)

    def _hold(self, s: float, ahead: FieldThing | None, *, familiar: bool) -> None:
        left = self._left(ahead, s) if ahead is not None and ahead.id in self.world.things else math.inf
        if ahead is not None and left < NEAR:
            self.tally.blocked.append((ahead.kind, round(left, 1)))
            self.world.remove(ahead.id)
        elif familiar:
            self.tally.false.append(f"{self.world.trail.zone(s)} {s:.0f} m blocked")
        self._blocked.clear()

    def _ahead(self, s: float) -> FieldThing | None:
        """Returns the nearest surprise ahead."""
        things = [thing for thing in self.world.things.values() if thing.surprise]
        return min(things, key=lambda thing: self._left(thing, s), default=None)

    def _left(self, thing: FieldThing, s: float) -> float:
        trail = self.world.trail
        return (trail.nearest(thing.x, thing.y)[0] - s) % trail.length

    def _is_familiar(self, s: float) -> bool:
        trail = self.world.trail
        marks = [trail.nearest(t.x, t.y)[0] for t in self.world.things.values() if t.surprise]
        marks += [begin for begin, _ in trail.borders.values()]
        return all(abs(math.remainder(mark - s, trail.length)) > FAMILIAR for mark in marks)


def engine_of(perceiver: Perceiver, words: str) -> AnyTraverse:
    corridor = Corridor(bottom=0.3, top=0.12, top_row=REGION.top)
    settings = replace(Settings.of(perceiver.defaults), region=REGION, corridor=corridor)
    return AnyTraverse(perceiver, settings, first_memory(perceiver.model_id, Preferences.parse(words)))


def main() -> None:
    """Prints a line for each seed, then all of it as one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--perceiver", default="builtin")
    parser.add_argument("--seeds", type=int, nargs="+", default=list(range(1, 21)))
    parser.add_argument("--size", default="320x240")
    parser.add_argument("--teach", default="", metavar="WORD")
    options = parser.parse_args()
    cv2.setNumThreads(1)
    perceiver = make_perceiver(options.perceiver, Runtime(threads=1))
    width, height = (int(part) for part in options.size.split("x"))
    tallies = []
    for seed in options.seeds:
        tally = _Drive(perceiver, seed, (width, height), options.teach).run()
        tallies.append(tally)
        called, blocked = (
            ", ".join(f"{kind} {left} m" for kind, left in found) or "none"
            for found in (tally.called, tally.blocked)
        )
        missed, false = ", ".join(tally.missed) or "none", "; ".join(tally.false) or "none"
        print(
            f"seed {seed}: called for {called}; blocked by {blocked}; missed {missed}; "
            f"places {tally.places}; false {false} ({tally.familiar} familiar frames)",
            flush=True,
        )
    wrong, familiar = sum(len(t.false) for t in tallies), sum(t.familiar for t in tallies)
    print(
        json.dumps(
            {
                "seeds": len(tallies),
                "things": sum(len(t.called) + len(t.blocked) + len(t.missed) for t in tallies),
                "missed": sum(len(t.missed) for t in tallies),
                "called": sum(len(t.called) for t in tallies),
                "nearest": min((left for t in tallies for _, left in t.called + t.blocked), default=None),
                "false_calls": wrong,
                "familiar_frames": familiar,
                "false_per_100": round(100 * wrong / max(familiar, 1), 3),
                "calls_for_places": sum(t.places for t in tallies),
                "taught": sum(t.taught for t in tallies),
            }
        )
    )


if __name__ == "__main__":
    main()
