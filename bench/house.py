"""Measures how simple the code is: `python -m bench.house`, or `make house`.

Lines are counted without blanks, comments and docstrings. Floors are the depth of imports: each module stands
on a floor above all modules that it imports. The floors of rooms count packages of companion/ instead. A walk
runs the daemon as `companion run` composes it, with a simulated camera and radio and in virtual time, and
counts the files in which a function was called: all of them, and those that an idle turn does not call.
"""

from __future__ import annotations

import ast
import io
import json
import sys
import tempfile
import tokenize
from collections.abc import Callable, Mapping
from pathlib import Path
from types import FrameType
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import development as mavlink

from anytraverse.frame import Frame
from anytraverse.operations import SetWord
from bench.link.lossy import STEP, Clock, virtual_time
from bench.link.rover import Companion, make_engine, make_ready
from bench.link.synthetic_frames import picture, thing
from companion.cameras.newest import CameraState, CameraStatus
from companion.config import Config
from companion.sim.loopback_link import Wire
from companion.sim.loopback_vision import LoopbackVision
from companion.tasks import VISION
from companion.vision.client import VisionClient
from companion.wire.answers import Answer
from companion.wire.ids import TUNNEL_ACKNOWLEDGEMENT, TUNNEL_ANSWER, TUNNEL_SUMMARY, Motion

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("anytraverse", "companion", "gcs_plugin", "tests", "bench")
SIMULATOR = "sim"
_TURNS = 400
_IDLE_TURNS = 15
"""Short enough for the last frame to stay fresh."""
_EMPTY = frozenset(
    getattr(tokenize, name) for name in ("COMMENT", "NL", "NEWLINE", "INDENT", "DEDENT", "ENDMARKER")
)
_HOLD, _DO_SET_MODE = 4, 176
Graph = Mapping[str, set[str]]


def main() -> int:
    """Prints the table; the last line is one JSON object."""
    figures: dict[str, Any] = {name: _size(sorted((ROOT / name).rglob("*.py"))) for name in PACKAGES}
    daemon = [p for p in (ROOT / "companion").rglob("*.py") if SIMULATOR not in p.parts]
    figures["companion without the simulator"] = _size(daemon)
    for name, (files, lines, short) in figures.items():
        print(f"{name:32} {files:4} files, {short:3} of them under 40 lines {lines:7} lines of code")
    modules = imports()
    rooms = rooms_of(modules)
    figures |= {"floors": _floors(modules), "floors_of_rooms": _floors(rooms), "circles": circles(rooms)}
    print(f"floors of imports: {figures['floors']} of modules, {figures['floors_of_rooms']} of rooms")
    print(f"rooms that import each other: {figures['circles'] or 'none'}")
    for name, (files, own, moves) in walks().items():
        figures[name] = {"files": files, "not_idle": own, "moves": moves}
        print(f"{name:32} {files:4} files, {own:3} of them not in an idle turn, {moves} moves between files")
    print(json.dumps(figures))
    return 0


def _size(paths: list[Path]) -> tuple[int, int, int]:
    """Files, lines of code, and how many files have under 40 lines of any kind."""
    short = sum(len(path.read_text().splitlines()) < 40 for path in paths if path.name != "__init__.py")
    return len(paths), sum(_code_lines(path) for path in paths), short


def _code_lines(path: Path) -> int:
    source = path.read_text()
    told: set[int] = set()
    for node in ast.walk(ast.parse(source)):
        for statement in (
            getattr(node, "body", None) or () if not isinstance(node, ast.Lambda | ast.IfExp) else ()
        ):
            if isinstance(statement, ast.Expr) and isinstance(statement.value, ast.Constant):
                told.update(range(statement.lineno, (statement.end_lineno or statement.lineno) + 1))
    lines: set[int] = set()
    for token in tokenize.generate_tokens(io.StringIO(source).readline):
        if token.type not in _EMPTY:
            lines.update(range(token.start[0], token.end[0] + 1))
    return len(lines - told)


def imports() -> dict[str, set[str]]:
    """Module of companion/ -> those that it imports, where and for whatever it does."""
    paths = {_name(path): path for path in sorted((ROOT / "companion").rglob("*.py"))}
    found: dict[str, set[str]] = {}
    for name, path in paths.items():
        found[name] = set()
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom) and node.module is not None:
                for one in node.names:
                    below = f"{node.module}.{one.name}"
                    found[name] |= {below if below in paths else node.module} & paths.keys() - {name}
    return found


def _name(path: Path) -> str:
    return ".".join(path.relative_to(ROOT).with_suffix("").parts).removesuffix(".__init__")


def rooms_of(modules: Graph) -> dict[str, set[str]]:
    """The same for rooms; what stands at companion's root is none."""
    rooms: dict[str, set[str]] = {}
    for module, imported in modules.items():
        here = _room(module)
        if here:
            rooms.setdefault(here, set()).update({_room(one) for one in imported} - {here, ""})
    return rooms


def _room(module: str) -> str:
    parts = module.split(".")
    return parts[1] if len(parts) > 1 and (ROOT / "companion" / parts[1]).is_dir() else ""


def _reached(graph: Graph, start: str) -> set[str]:
    seen: set[str] = set()
    waiting = list(graph.get(start, ()))
    while waiting:
        one = waiting.pop()
        if one not in seen:
            seen.add(one)
            waiting += graph.get(one, ())
    return seen


def circles(graph: Graph) -> list[list[str]]:
    """Those that reach each other, each circle once."""
    reached = {one: _reached(graph, one) for one in graph}
    found = {
        tuple(sorted(other for other in reached[one] if one in reached.get(other, ())))
        for one in graph
        if one in reached[one]
    }
    return [list(circle) for circle in sorted(found)]


def _floors(graph: Graph) -> int:
    known: dict[str, int] = {}

    def floor(one: str) -> int:
        if one not in known:
            known[one] = 1  # of a circle, the first that is met
            known[one] = 1 + max((floor(below) for below in graph.get(one, ())), default=0)
        return known[one]

    return max(floor(one) for one in graph)


class _Walk:
    """Which files of ours functions were called in."""

    def __init__(self) -> None:
        self.files: set[str] = set()
        self.moves = 0
        self._last = ""

    def __enter__(self) -> _Walk:
        sys.setprofile(self._called)
        return self

    def __exit__(self, *_: object) -> None:
        sys.setprofile(None)

    def _called(self, frame: FrameType, event: str, _: Any) -> None:
        name = frame.f_code.co_filename
        if event != "call" or not name.startswith((str(ROOT / "companion"), str(ROOT / "anytraverse"))):
            return
        if SIMULATOR in Path(name).relative_to(ROOT).parts:
            return
        self.files.add(name)
        self.moves += name != self._last
        self._last = name


class _Stage(Companion):
    """A daemon that drives over grass in AUTO, with policy hold."""

    def __init__(self, folder: Path, clock: Clock) -> None:
        self._clock = clock
        self.radio = Wire()
        self.child = LoopbackVision(make_engine)
        vision = VisionClient(lambda: self.child, Config(), None, VISION)
        make_ready(vision, self.child)
        super().__init__(folder, lambda: self.radio.near, vision, policy="hold")
        self._frame_id = 0
        self._grain = np.random.default_rng(0)
        self._beat_at = 0.0

    def turn(self) -> None:
        """One of the daemon's, and what it sent."""
        self._clock.now += STEP
        now = self._clock.now
        if now >= self._beat_at:
            self._beat_at = now + 1.0
            self.radio.heartbeat(1)
        super().turn()
        self.radio.collect(now)

    def see(self, shows: int = 0) -> None:
        """The vision process judges a frame of this."""
        now = self._clock.now
        self._frame_id += 1
        self.child.live(CameraStatus(CameraState.DELIVERING), now)
        self.child.work()
        image = picture(shows)
        image[1:, :, 2] = self._grain.integers(0, 256, image.shape[:2])[1:]  # no two are alike
        self.child.judge(Frame(self._frame_id, now, image))

    def sent(self, kind: int) -> int:
        """How many TUNNEL payloads of this type left."""
        return len(self.radio.tunnels(kind))

    def holds(self) -> int:
        """How often HOLD was commanded."""
        commands = self.radio.sent("COMMAND_LONG")
        return sum(one.command == _DO_SET_MODE and one.param2 == _HOLD for one in commands)


def walks() -> dict[str, tuple[int, int, int]]:
    """Files, those that an idle turn does not call, and moves from one file to another.

    Raises RuntimeError where a walk has no file of its own: then something else was counted.
    """
    idle, frame, fault, answer = _Walk(), _Walk(), _Walk(), _Walk()
    with tempfile.TemporaryDirectory() as folder, virtual_time() as clock:
        stage = _Stage(Path(folder), clock)
        _until(stage, lambda: stage.sent(TUNNEL_SUMMARY) > 2, seeing=0)
        with idle:
            for _ in range(_IDLE_TURNS):
                stage.turn()
        told = stage.sent(TUNNEL_SUMMARY)
        with frame:
            _until(stage, lambda: stage.sent(TUNNEL_SUMMARY) > told, seeing=0)
        with fault:
            _until(stage, lambda: stage.holds() > 0, seeing=None)
        stage.radio.mode = _HOLD
        _until(stage, lambda: stage.calls.call is not None, seeing=1)
        payload = Answer(0, Motion.GO, (SetWord(thing(1), 1.0),), 1).pack()
        padded = list(payload.ljust(128, b"\0"))
        stage.radio.send(mavlink.MAVLink_tunnel_message(1, 191, TUNNEL_ANSWER, len(payload), padded))
        with answer:
            _until(stage, lambda: stage.sent(TUNNEL_ACKNOWLEDGEMENT) > 0, seeing=None)
        stage.close()
    walks = {"frame to summary": frame, "answer to acknowledgement": answer, "fault to hold": fault}
    for name, walk in walks.items():
        if not walk.files - idle.files:
            raise RuntimeError(f"the walk from {name} has no file of its own: it was not counted")
    return {name: (len(walk.files), len(walk.files - idle.files), walk.moves) for name, walk in walks.items()}


def _until(stage: _Stage, done: Callable[[], bool], *, seeing: int | None) -> None:
    """Turns until `done`. seeing: what frames show, None: none come."""
    for _ in range(_TURNS):
        if done():
            return
        if seeing is not None:
            stage.see(seeing)
        else:
            stage.child.work()
        stage.turn()
    raise RuntimeError(f"not done in {_TURNS} turns")


if __name__ == "__main__":
    sys.exit(main())
