"""Implements `companion costmap`: what the grid of the ground knows at a moment of a recorded drive."""

from __future__ import annotations

import math
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from anytraverse.errors import AnyTraverseError
from anytraverse.frame import Image
from anytraverse.grid import LocalGrid
from anytraverse.grid_map import GridMap, draw_from_above
from anytraverse.judging import Settings
from companion.config import Config, load_config
from companion.config.stopping import Stopping, judge_stopping
from companion.desk.costmap.files import write_costmap
from companion.desk.drives.drive import DriveError
from companion.desk.drives.frames import is_recording, located
from companion.desk.drives.recorded import RecordedDrive
from companion.desk.drives.replay import judged_again
from companion.desk.drives.replaying import config_of
from companion.desk.ground.look_ground import MountError, missing
from companion.vision.warm_up import load_engine


@dataclass
class _Replay:
    """What became of the frames. placed: how many have a pose. left_out: why -> how many."""

    grid: LocalGrid = field(default_factory=LocalGrid)
    frames: int = 0
    placed: int = 0
    at: float = 0.0
    left_out: Counter[str] = field(default_factory=Counter)


def run(where: str, *, file: str | None, out: str, at: float | None) -> int:
    """Replay a recording up to its end, or `at` seconds after its first frame, and write its grid to `out`.

    file: the configuration; None: that of the recording. Returns 0, and 1 where the grid knows nothing: it
    is not known how the vehicle drove, or no frame can be judged.
    Raises MountError, DriveError, ConfigError, AnyTraverseError and OSError.
    """
    path = located(where)[1]
    if not is_recording(path):
        raise DriveError(f"{where} is no recording: only these tell how the vehicle drove")
    recording = RecordedDrive(path)
    config = load_config(file) if file else config_of(recording)
    camera = config.ground_camera
    if camera is None:
        raise MountError(f"{file or recording.title}: {missing(config)}")
    engine, _ = load_engine(config, None, misfit_allowed=True)
    found, base = _Replay(), engine.settings
    begun = math.nan
    for recorded in recording.recorded():
        frame = recorded.frame
        begun = begun if math.isfinite(begun) else frame.at
        if at is not None and frame.at - begun > at:
            break
        found.frames, found.at = found.frames + 1, frame.at - begun
        found.placed += frame.pose is not None
        try:
            again = judged_again(engine, recorded, base)
        except AnyTraverseError as error:
            again = str(error)
        if isinstance(again, str) or again.maps is None:
            found.left_out[again if isinstance(again, str) else "it could not be judged"] += 1
            found.grid.move(frame.pose, frame.at)
        else:
            leaning = camera.leaning(*(frame.lean or (0.0, 0.0)))
            found.grid.update(again.maps, leaning, frame.pose, frame.at)
    return _report(found, Path(out), partial(_drawn, config, engine.settings))


def _drawn(config: Config, settings: Settings, told: GridMap) -> Image:
    judged = judge_stopping(config)
    stops = judged.needs if isinstance(judged, Stopping) else None
    return draw_from_above(told, settings.metres, stops)


def _report(found: _Replay, out: Path, draw: Callable[[GridMap], Image]) -> int:
    for why, count in found.left_out.items():
        print(f"not in it, {why}: {count} frames")
    pose, told = found.grid.pose, GridMap.of(found.grid, found.at)
    if not found.placed:
        print(
            "it is not known how the vehicle drove: no frame has a pose. That needs the autopilot's position "
            "and ATTITUDE, and a companion that records it"
        )
        return 1
    if pose is None or told is None or not found.grid.known.any():
        print(f"nothing is known {found.at:.1f} s after the first frame: give another --at")
        return 1
    known, drivable = int(found.grid.known.sum()), int(found.grid.drivable.sum())
    print(f"{found.frames} frames, {found.at:.1f} s: {known} cells are known, {drivable} of them drivable")
    for path in write_costmap(out, found.grid, pose, draw(told)):
        print(f"  {path}")
    return 0
