"""Counts clean frames that are not OK, and why, for several shares of the corridor that must be drivable.

A frame of the labelled folder is clean if every pixel of its region of interest is labelled as drivable;
--count of them are taken, spread evenly by number. --unlabelled adds a folder whose pictures are all clean.
Run: python -m bench.false_stops FOLDER --drivable "smooth_trail,rough_trail,grass" [--count 100]
[--unlabelled FOLDER] [--words "trail: 1; grass: 1; bush: -1"] [--shares 0.75 0.8 0.85 0.9] The last line is
one JSON object.
"""

from __future__ import annotations

import argparse
import json
from collections import Counter
from dataclasses import replace
from pathlib import Path

import cv2

from anytraverse.assessment import Observation
from anytraverse.engine import AnyTraverse
from anytraverse.evaluation.datasets import Dataset, open_folder
from anytraverse.frame import Frame, Image
from anytraverse.judging import Settings
from anytraverse.look import DEFAULT_PROMPTS, read_picture
from anytraverse.memory import first_memory
from anytraverse.perception import make_perceiver
from anytraverse.perception.runtime import Runtime
from anytraverse.preferences import Preferences


def clean_frames(folder: Dataset, drivable: list[str], count: int) -> list[Image]:
    """Returns at most `count` pictures, spread by number, with only `drivable` in the region of interest."""
    classes = folder.classes.choose(drivable)
    region = Settings().region
    clean = []
    for frame in folder.frames(print):
        inside = region.mask(*frame.labels.shape)
        if folder.classes.mask(frame.labels, classes)[inside].all():
            clean.append(frame.image)
    return [clean[index * len(clean) // count] for index in range(count)] if len(clean) > count else clean


def stops(engine: AnyTraverse, frames: list[Observation], share: float) -> tuple[int, Counter[str]]:
    """Counts the frames that are not OK, in all and for each figure."""
    settings = engine.settings
    engine.settings = replace(settings, corridor=replace(settings.corridor, share=share))
    judged = [engine.judge(seen, seen.frame.captured_at) for seen in frames]
    engine.settings = settings
    figures = Counter(name for one in judged for name in {finding.figure for finding in one.bad})
    return sum(not one.ok for one in judged), figures


def main() -> None:
    """Prints a line for each share, then all of it as one JSON object."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--drivable", required=True, help="the drivable classes, with commas")
    parser.add_argument("--count", type=int, default=100)
    parser.add_argument("--unlabelled", type=Path)
    parser.add_argument("--words", default=DEFAULT_PROMPTS)
    parser.add_argument("--perceiver", default="builtin")
    parser.add_argument("--shares", type=float, nargs="+", default=[0.75, 0.8, 0.85, 0.9])
    options = parser.parse_args()
    cv2.setNumThreads(1)
    perceiver = make_perceiver(options.perceiver, Runtime(threads=1))
    settings = Settings.of(perceiver.defaults)
    words = Preferences.parse(options.words)
    engine = AnyTraverse(perceiver, settings, first_memory(perceiver.model_id, words))
    sets = {"clean": clean_frames(open_folder(options.folder), options.drivable.split(","), options.count)}
    if options.unlabelled:
        sets["unlabelled"] = [read_picture(str(path)) for path in sorted(options.unlabelled.glob("*.jpg"))]
    told = {}
    for name, pictures in sets.items():
        frames = [engine.observe(Frame(number, 0.0, image)) for number, image in enumerate(pictures)]
        for share in options.shares:
            bad, figures = stops(engine, frames, share)
            listed = ", ".join(f"{figure} {count}" for figure, count in figures.most_common()) or "nothing"
            print(f"{name}, share {share:.2f}: {bad} of {len(frames)} not OK: {listed}", flush=True)
            told[f"{name} {share:g}"] = bad
    print(json.dumps({"words": words.format(), "not_ok": told, **{k: len(v) for k, v in sets.items()}}))


if __name__ == "__main__":
    main()
