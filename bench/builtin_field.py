"""Measures the built-in perceiver on the simulated trail, seed by seed.

Drives clean trails and trails with surprises in the light of day, and prints, per seed and light: alarms on
clean trail (2 of 3 frames, by reason), the highest uncertainty there, from how far each surprise was seen,
similarities within and between zones; then two laps with an operator who answers every call.
Run: python -m bench.builtin_field [--perceiver builtin] [--seeds 8] [--lights 0.5 1 1.6] [--size 320x240]

What came out with builtin:lexicon, seeds 1 to 8, light x 0.5, 1 and 1.6: no debounced alarm on clean trail
(worst tile at most .19 where its words apply, .28 at a puddle; the threshold is .25); drum seen from 5.1 m,
rock from 4.6 m, log from 5.6 m; in the first lap one call for each of drum, forest, rock, gravel and log, in
the second none. 1.8 ms a frame of 320x240, 2.5 ms of 640x480. For builtin: bench/field_goal.py.
"""

from __future__ import annotations

import argparse
import math
import time
from collections import defaultdict
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from anytraverse.answers import Changes, Tap
from anytraverse.assessment import Assessment, Reason
from anytraverse.engine import AnyTraverse
from anytraverse.frame import Frame
from anytraverse.judging import Settings
from anytraverse.memory import first_memory
from anytraverse.perception import Perceiver, make_perceiver
from anytraverse.perception.runtime import Runtime
from anytraverse.preferences import Preferences
from anytraverse.regions import Box
from anytraverse.roi import Corridor
from companion.calls.numbers import Numbers
from companion.calls.reason_filter import CALLS_FOR_WORDS, ReasonFilter
from companion.sim.field.render import Camera
from companion.sim.field.things import Thing, World
from companion.sim.field.trail import Pose

STEP = 0.5  # m between two frames
SPEED = 2.0  # m/s
REGION = Box(0.35, 0.5, 0.65, 0.95)  # of a fast rover, as in the demo
WORDS = {
    "meadow": "grass: 1; dirt path: 1; sky: -0.5; bush: -1; tree: -1",
    "forest": "grass: 1; dirt path: 1; sky: -0.5; bush: -1; tree: -1",
    "gravel": "grass: 1; dirt path: 1; sky: -0.5; bush: -1; tree: -1; gravel: 1; dry grass: 0.5",
}
SEEN_FROM = 12.0  # m, beyond which an alarm is not about the surprise


def drive(
    perceiver: Perceiver, seed: int, light: float, surprises: tuple[str, ...], size: tuple[int, int]
) -> Iterator[tuple[float, str, Assessment, World]]:
    """Drives one lap and judges each frame with its zone's words; yields place, zone, assessment, world."""
    world = World(seed, surprises)
    world.light = light
    camera = Camera(world, *size)
    engines = {zone: engine_of(perceiver, words) for zone, words in WORDS.items()}
    trail = world.trail
    for s in np.arange(trail.start, trail.start + trail.length, STEP):
        image, _ = camera.render(trail.pose(float(s)), float(s) / SPEED)
        # words of a new zone are given when its scene is noticed, some metres before the border
        zone = trail.zone(float(s) + 4.0) if trail.zone(float(s)) != "gravel" else "gravel"
        engine = engines[zone]
        yield float(s), trail.zone(float(s)), engine.judge(engine.observe(Frame(0, 0.0, image)), 0.0), world


def debounced(flags: list[bool]) -> list[bool]:
    """Whether 2 of the last 3 frames are bad."""
    return [sum(flags[max(0, i - 2) : i + 1]) >= 2 for i in range(len(flags))]


def clean(
    perceiver: Perceiver, seed: int, light: float, size: tuple[int, int]
) -> dict[str, list[NDArray[np.float32]]]:
    """Prints alarms and the highest uncertainties on a clean trail; returns embeddings by zone."""
    frames = list(drive(perceiver, seed, light, (), size))
    scenes = defaultdict(list)
    for zone in WORDS:
        own = [(s, a) for s, z, a, _ in frames if z == zone]
        roi = [a.roi.uncertainty for _, a in own if a.roi]
        tile = [a.roi.worst_tile.uncertainty for _, a in own if a.roi]
        alarms = {
            reason: sum(debounced([reason in a.reasons for _, a in own]))
            for reason in (Reason.UNKNOWN_OBJECT, Reason.BLOCKED)
        }
        trav = min(a.roi.traversability for _, a in own if a.roi)
        text = ", ".join(f"{reason.value} {count}" for reason, count in alarms.items() if count) or "none"
        where = [f"{s:.0f}" for s, a in own if a.reasons]
        print(
            f"  {seed} x{light:<3} {zone:6} n={len(own):3}  roi {np.median(roi):.2f} max {max(roi):.2f}"
            f"  tile p50 {np.median(tile):.2f} p95 {np.quantile(tile, 0.95):.2f} max {max(tile):.2f}"
            f"  trav min {trav:.2f}  alarms {text} {' '.join(where)}"
        )
        scenes[zone] = [a.observation.embedding for _, a in own if a.observation]
    return scenes


def surprises(perceiver: Perceiver, seed: int, light: float, size: tuple[int, int]) -> dict[str, float]:
    """Returns from how far (m) each surprise raised a debounced alarm; 0 for never."""
    seen: dict[str, float] = {}
    recent: dict[str, list[bool]] = defaultdict(list)
    for s, _, assessment, world in drive(perceiver, seed, light, ("drum", "rock", "log"), size):
        for thing in world.things.values():
            if not thing.surprise:
                continue
            pose = world.trail.pose(s)
            ahead = math.hypot(thing.x - pose.x, thing.y - pose.y)
            forward = (thing.x - pose.x) * math.cos(pose.heading) + (thing.y - pose.y) * math.sin(
                pose.heading
            )
            if forward <= 0 or ahead > SEEN_FROM:
                continue
            recent[thing.kind].append(Reason.UNKNOWN_OBJECT in assessment.reasons)
            if debounced(recent[thing.kind])[-1]:
                seen.setdefault(thing.kind, ahead)
    return {kind: round(seen.get(kind, 0.0), 1) for kind in ("drum", "rock", "log")}


def laps(perceiver: Perceiver, seed: int, size: tuple[int, int]) -> list[list[str]]:
    """Returns the calls of two laps in which the operator names each place, and taps and removes each thing.

    A thing's call is followed by how the frame is judged after the tap.
    """
    world = World(seed)
    camera = Camera(world, *size)
    engine = engine_of(perceiver, WORDS["meadow"])
    trail, calls = world.trail, []
    counted = ReasonFilter(Numbers(judging=engine.settings), 0.0)
    for lap in range(2):
        calls.append(list[str]())
        for s in np.arange(trail.start, trail.start + trail.length + (10.0 if lap else 0.0), STEP):
            now = (lap * trail.length + float(s)) / SPEED
            world.light = 1 + 0.4 * math.sin(now / 7)
            pose = trail.pose(float(s))
            judged = engine.step(Frame(round(now * 10), now, camera.render(pose, now)[0]), now)
            counted.add_frame(judged, now, None)
            if not counted.reasons(now) & CALLS_FOR_WORDS:
                continue
            ahead = [t for t in world.things.values() if t.surprise and _away(pose, t) < 8]
            if Reason.UNKNOWN_SCENE in judged.reasons or not ahead or judged.tile is None:
                changes = Changes(weights=dict(Preferences.parse(WORDS[trail.zone(float(s) + 4.0)])))
            else:
                changes = Changes(taps=(Tap(judged.frame.id, judged.tile.shown, ahead[0].kind, -1.0),))
            outcome = engine.answer(
                changes, now, call=judged.observation, call_id=len(calls[-1]) + 1, go=True
            )
            after = sorted(reason.value for reason in outcome.call.reasons) if outcome.call else []
            what = ahead[0].kind if changes.taps else trail.zone(float(s) + 4.0)
            calls[-1].append(f"{s:.0f} m {what} -> {'+'.join(after) or 'ok'}")
            if changes.taps:
                world.remove(ahead[0].id)
            counted.restart_after_answer(now)
    return calls


def _away(pose: Pose, thing: Thing) -> float:
    return math.hypot(thing.x - pose.x, thing.y - pose.y)


def engine_of(perceiver: Perceiver, words: str) -> AnyTraverse:
    corridor = Corridor(bottom=0.3, top=0.12, top_row=REGION.top)
    settings = replace(Settings.of(perceiver.defaults), region=REGION, corridor=corridor)
    return AnyTraverse(perceiver, settings, first_memory(perceiver.model_id, Preferences.parse(words)))


def similarities(scenes: dict[str, list[NDArray[np.float32]]]) -> str:
    """Returns a line of cosines of each zone's frames to a frame inside each zone: low, median, high."""
    parts = []
    for zone, reference in ((zone, own[len(own) // 3]) for zone, own in scenes.items()):
        for other, own in scenes.items():
            cosines = np.array(own) @ reference
            low, middle, high = np.quantile(cosines, (0.05, 0.5, 0.95))
            parts.append(f"{zone[:1]}-{other[:1]} {low:.2f}/{middle:.2f}/{high:.2f}")
    return "  ".join(parts)


def timed(perceiver: Perceiver, size: tuple[int, int]) -> float:
    """Measures encode, attend (eight words) and embed on one core: milliseconds, the median of 50."""
    import cv2

    from anytraverse.perception import Prompt

    cv2.setNumThreads(1)
    world = World(1)
    image, _ = Camera(world, *size).render(world.trail.pose(30.0), 0.0)
    prompts = [Prompt(word) for word in Preferences.parse(WORDS["gravel"] + "; water: -1")]
    taken = []
    for _ in range(50):
        begin = time.perf_counter()
        features = perceiver.encode(image)
        perceiver.attend(features, prompts)
        perceiver.embed(features)
        taken.append(time.perf_counter() - begin)
    return float(np.median(taken) * 1e3)


def main() -> None:
    """Runs all measurements."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seeds", type=int, default=8)
    parser.add_argument("--lights", nargs="*", type=float, default=[0.5, 1.0, 1.6])
    parser.add_argument("--size", default="320x240")
    parser.add_argument("--perceiver", default="builtin")
    options = parser.parse_args()
    perceiver = make_perceiver(options.perceiver, Runtime(threads=1))
    width, height = (int(part) for part in options.size.split("x"))
    size = (width, height)
    print(f"{timed(perceiver, size):.1f} ms a frame of {options.size}")
    for seed in range(1, options.seeds + 1):
        for number, calls in enumerate(laps(perceiver, seed, size), 1):
            print(f"  {seed} lap {number}: {len(calls)} calls: {'; '.join(calls)}")
        for light in options.lights:
            scenes = clean(perceiver, seed, light, size)
            print(f"    similarity {similarities(scenes)}")
            print(f"    seen from  {surprises(perceiver, seed, light, size)}")


if __name__ == "__main__":
    main()
