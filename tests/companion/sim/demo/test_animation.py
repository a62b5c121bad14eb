"""The animation of the demo: made of a recording, and read back."""

from __future__ import annotations

import json
from itertools import pairwise
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from mcap.writer import Writer

from anytraverse.regions import Box
from companion.observers.recording import contents
from companion.observers.recording.topics import TOPICS, Topic
from companion.sim.demo import animation as module
from companion.sim.demo.animation import LARGEST, RATE, WIDTH, AnimationError, Moment, animate

REGION = Box(0.35, 0.46, 0.65, 0.95)
NS = 1_000_000_000
BEGAN = 500.0
"""Monotonic s of the first frame."""
TILE = {"box": {"left": 0.4, "top": 0.5, "right": 0.5, "bottom": 0.6}, "around": None, "uncertainty": 0.9}
MOMENTS = (
    Moment(BEGAN + 2.5, "call", "something here fits none of its words"),
    Moment(BEGAN + 3.5, "answer", "tap drum -1 go", (0.4, 0.5, 0.5, 0.6)),
    Moment(BEGAN + 4.5, "told", "somebody takes the drum away"),
    Moment(BEGAN + 5.5, "drives on", "the rover drives on"),
)


def record(folder: Path) -> None:
    """Eight seconds of a rover that stops from 2.5 to 5.5 s: grey pictures that become brighter."""
    folder.mkdir(parents=True)
    with (folder / "000001.mcap").open("wb") as file:
        writer = Writer(file)
        writer.start()
        channels = {}
        for topic in Topic:
            row = TOPICS[topic]
            schema = writer.register_schema(row.schema, row.schema_encoding, row.schema_data)
            channels[topic] = writer.register_channel(row.name, row.encoding, schema)

        def add(topic: Topic, at: float, data: bytes, number: int = 0) -> None:
            writer.add_message(channels[topic], round(at * NS), data, round(at * NS), number)

        maps = np.full((48, 64), 255, np.uint8), np.zeros((48, 64), np.uint8)
        for number in range(40):
            at = BEGAN + number / 5
            stands = 2.5 <= at - BEGAN < 5.5
            grey = np.full((240, 320, 3), 60 + 4 * number, np.uint8)
            add(Topic.CAMERA, at, contents.image(encoded(".jpg", grey), "jpeg", 0), number)
            for topic, values in zip((Topic.TRAVERSABILITY, Topic.UNCERTAINTY), maps, strict=True):
                add(topic, at, contents.image(encoded(".png", values), "png", 0), number)
            seen = {
                "captured_at": at,
                "judged_at": at + 0.05,
                "reasons": ["unknown_object"] if stands else [],
                "roi": {"worst_tile": TILE},
            }
            add(Topic.ASSESSMENT, at + 0.05, json.dumps(seen).encode(), number)
            state = {"state": "calling" if stands else "ok"}
            add(Topic.STATE, at + 0.06, json.dumps(state).encode())
        writer.finish()


def encoded(kind: str, picture: Any) -> bytes:
    return cv2.imencode(kind, picture)[1].tobytes()


def read(file: Path) -> list[Any]:
    """The picture of each eighth of a second: WebP joins those that are the same."""
    done, animation = cv2.imreadanimation(str(file))
    assert done
    assert sum(animation.durations) == pytest.approx(10_000, abs=100)
    pairs = zip(animation.frames, animation.durations, strict=True)
    return [frame for frame, lasts in pairs for _ in range(round(lasts * RATE / 1000))]


def near(pixel: Any, colour: tuple[int, int, int]) -> bool:
    """Whether a pixel, BGR, has about this colour, RGB."""
    return bool(np.abs(pixel[:3][::-1].astype(int) - colour).max() < 40)


@pytest.mark.slow
def test_ten_seconds_show_the_state_the_judgement_and_the_answer_as_it_is_given(tmp_path: Path) -> None:
    record(tmp_path / "recordings")
    file = tmp_path / "demo.webp"
    assert animate(tmp_path / "recordings", MOMENTS, REGION, file) == file.stat().st_size <= LARGEST
    frames = read(file)
    assert len(frames) == round(10 * RATE)
    assert {frame.shape[1] for frame in frames} == {WIDTH}
    # From 0.5 to 8.0 s of the drive, in 10 s.
    at = {second: frames[round((second - 0.5) / 7.5 * 80)] for second in (1.0, 3.0, 3.9, 5.0, 7.0)}
    green, amber = (0, 158, 115), (230, 159, 0)
    bars = {second: frame[4, 4] for second, frame in at.items()}
    assert near(bars[1.0], green)
    assert near(bars[3.0], amber)
    assert near(bars[7.0], green)
    yellow = {
        second: near(frame[52 + 210, round(0.4 * WIDTH)], (255, 225, 60)) for second, frame in at.items()
    }
    assert (yellow[1.0], yellow[3.0], yellow[7.0]) == (False, True, False), "the box where to look"
    feet = [frame[-50:].astype(int) for frame in at.values()]
    told = [int(np.abs(after - before).max()) for before, after in pairwise(feet)]
    assert min(told) > 100, "what colours mean, why it asks, the answer, what follows, and that it drives on"


@pytest.mark.slow
def test_an_answer_appears_letter_by_letter(tmp_path: Path) -> None:
    record(tmp_path / "recordings")
    file = tmp_path / "demo.webp"
    animate(tmp_path / "recordings", MOMENTS, REGION, file)
    frames = read(file)
    typed = [frames[round((second - 0.5) / 7.5 * 80)] for second in (3.7, 4.0, 4.4)]
    widths = [np.flatnonzero((frame[-50:, :, 1] > 150).any(axis=0)).max() for frame in typed]
    assert widths == sorted(set(widths))


@pytest.mark.slow
def test_a_large_one_is_made_smaller(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    record(tmp_path / "recordings")
    file = tmp_path / "demo.webp"
    large = animate(tmp_path / "recordings", MOMENTS, REGION, file)
    monkeypatch.setattr(module, "LARGEST", large - 1)
    assert animate(tmp_path / "recordings", MOMENTS, REGION, file) < large


@pytest.mark.parametrize("moments", [(), MOMENTS[:2], MOMENTS[2:], (MOMENTS[0], MOMENTS[3])])
def test_without_a_call_that_was_tapped_and_driven_on_from_it_says_so(
    tmp_path: Path, moments: tuple[Moment, ...]
) -> None:
    with pytest.raises(AnimationError, match="no call was answered by a tap"):
        animate(tmp_path, moments, REGION, tmp_path / "demo.webp")
    assert not (tmp_path / "demo.webp").exists()


def test_without_a_recording_it_says_so(tmp_path: Path) -> None:
    with pytest.raises(AnimationError, match="nothing was recorded"):
        animate(tmp_path, MOMENTS, REGION, tmp_path / "demo.webp")


def test_the_animation_of_the_readme_lasts_ten_seconds() -> None:
    file = Path(__file__).parents[4] / "docs" / "demo.webp"
    assert len(read(file)) == 10 * RATE
    assert file.stat().st_size < 1_500_000
    assert "(docs/demo.webp)" in (file.parents[1] / "README.md").read_text(encoding="utf-8")
