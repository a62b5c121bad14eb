"""Runs `companion demo --camera folder:... --every`: judges each frame of a folder in turn, none left out.

Time is the drive's, ten frames a second, whatever the computer takes. So a folder always gives the same
calls, and curves of them can be compared. There is no camera, link or other process.
"""

from __future__ import annotations

import json
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from anytraverse.answers import Changes
from anytraverse.assessment import Assessment
from anytraverse.errors import AnyTraverseError
from anytraverse.frame import Frame
from anytraverse.look import read_picture
from companion.calls.decisions import CallOpened, Decision, WouldHold
from companion.calls.machine import OperatorCalls
from companion.calls.policy import PolicyState
from companion.cameras import SourceError, split_source
from companion.cameras.folder import pictures
from companion.config import Config, load_config
from companion.settings.mapping import call_numbers
from companion.sim.demo.config import write_config
from companion.sim.demo.story import Story
from companion.vision.warm_up import load_engine
from companion.wire.ids import Motion, Policy

THINK = 1.5
"""Seconds of the drive after which a call is answered with go."""
_TOLD_EVERY = 10.0
_NO_LINK = "udpout:127.0.0.1:9"
"""A configuration needs a link. Nothing is sent."""


@dataclass
class Figures:
    """Counts what became of the frames. at_call, at_match: numbers of the frames, from 1."""

    frames: int = 0
    torn: list[str] = field(default_factory=list)
    not_ok: int = 0
    would_hold: int = 0
    at_call: list[int] = field(default_factory=list)
    at_match: list[int] = field(default_factory=list)


def judge_every(camera: str, out: Path, story: Story) -> int:
    """Judge the folder's frames in name order, and write frames.jsonl. Returns 0, or 1 without any frame.

    Raises CameraError for anything but a folder of pictures, ConfigError and AnyTraverseError.
    """
    if not camera:
        raise SourceError("--every needs --camera folder:PATH, whose pictures it judges")
    kind, folder = split_source(camera)
    if kind != "folder":
        raise SourceError(f"--every judges the pictures of a folder, and {camera} is none: give folder:PATH")
    found = pictures(Path(folder).expanduser().absolute())
    config = load_config(write_config(out, camera=camera, link=_NO_LINK, policy="shadow"))
    story.plain(f"All {len(found)} frames of {folder} are judged in turn. Each call is answered with go.")
    figures, started, told_at = Figures(), time.monotonic(), time.monotonic()
    drive = _Drive(config, figures)
    with (out / "frames.jsonl").open("w", encoding="utf-8") as lines:
        try:
            for number, path in enumerate(found, 1):
                row = drive.judge(number, path)
                if row is not None:
                    lines.write(json.dumps(row) + "\n")
                if time.monotonic() - told_at > _TOLD_EVERY:
                    told_at = time.monotonic()
                    story.plain(f"{number} of {len(found)} frames, {len(figures.at_call)} calls")
        except KeyboardInterrupt:
            story.plain("ended before the last frame")
    if figures.torn:
        story.plain(
            f"{len(figures.torn)} files cannot be read, and are left out: {', '.join(figures.torn[:5])}"
        )
    story.plain(f"One line for each frame: {out / 'frames.jsonl'}")
    told = {
        "frames": figures.frames,
        "torn": len(figures.torn),
        "not_ok": figures.not_ok,
        "calls": len(figures.at_call),
        "would_hold": figures.would_hold,
        "matches": len(figures.at_match),
        "at_call": figures.at_call,
        "at_match": figures.at_match,
        "drive_s": round(figures.frames / config.camera.rate, 1),
        "seconds": round(time.monotonic() - started, 1),
    }
    story.plain(json.dumps(told))
    return 0 if figures.frames else 1


class _Drive:
    """Judges frames by engine and state machine, as the daemon does in shadow policy, in the drive's time."""

    def __init__(self, config: Config, figures: Figures) -> None:
        self._engine, _ = load_engine(config, None)
        numbers = call_numbers(config, self._engine.settings)
        self._calls = OperatorCalls(numbers, PolicyState(Policy.SHADOW), 0.0)
        self._period = 1.0 / config.camera.rate
        self._figures = figures

    def judge(self, number: int, path: Path) -> dict[str, Any] | None:
        """Judge a frame, and answer the open call when it is due. Returns its row, None for a torn file."""
        now = number * self._period
        try:
            image = read_picture(str(path))
        except (OSError, AnyTraverseError):
            self._figures.torn.append(path.name)
            self._calls.tick(now)
            return None
        seen = self._engine.step(Frame(number, now, image), now)
        self._count(seen, self._calls.assessed(seen, now))
        row = _row(path.name, seen, self._calls.current_id)
        self._answer(now)
        return row

    def _count(self, seen: Assessment, decisions: list[Decision]) -> None:
        figures = self._figures
        figures.frames += 1
        figures.not_ok += not seen.ok
        figures.at_call += [seen.frame.id for one in decisions if isinstance(one, CallOpened)]
        figures.would_hold += sum(isinstance(one, WouldHold) for one in decisions)
        figures.at_match += [seen.frame.id] if seen.adopted is not None else []

    def _answer(self, now: float) -> None:
        call = self._calls.call
        if call is None or call.answered or now - call.opened_at < THINK:
            return
        observation = call.seen.observation if call.seen is not None else None
        outcome = self._engine.answer(Changes(), now, call=observation, call_id=call.id, go=True)
        self._calls.apply_answer(call.id, Motion.GO, False, outcome, now)  # noqa: FBT003


def _row(name: str, seen: Assessment, open_id: int) -> dict[str, Any]:
    figures = {
        "roi_uncertainty": seen.roi.uncertainty if seen.roi is not None else None,
        "worst_tile": seen.roi.worst_tile.uncertainty if seen.roi is not None else None,
        "drivable_share": seen.roi.drivable_share if seen.roi is not None else None,
        "similarity": seen.similarity,
        "match": seen.match.similarity if seen.match is not None else None,
    }
    return {
        "frame": seen.frame.id,
        "file": name,
        "ok": seen.ok,
        "reasons": sorted(reason.value for reason in seen.reasons),
        **{key: None if value is None else round(value, 4) for key, value in figures.items()},
        "known_place": seen.adopted.order if seen.adopted is not None else None,
        "open": open_id,
    }
