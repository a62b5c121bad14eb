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
from functools import partial
from pathlib import Path
from types import FrameType
from typing import Any

from bench.link.lossy import STEP
from bench.virtual_time import virtual_time
from companion.wire.ids import TUNNEL_SUMMARY, Motion
from tests.companion.daemon.rig import HOLD, PERIOD, Rig

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("anytraverse", "companion", "gcs_plugin", "tests", "bench")
SIMULATOR = "sim"
_STEPS = 100
_IDLE_TURNS = 15
"""Short enough for the last frame to stay fresh."""
_EMPTY = frozenset(
    getattr(tokenize, name) for name in ("COMMENT", "NL", "NEWLINE", "INDENT", "DEDENT", "ENDMARKER")
)
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


def walks() -> dict[str, tuple[int, int, int]]:
    """Files, those that an idle turn does not call, and moves from one file to another.

    Raises RuntimeError where a walk has no file of its own: then something else was counted.
    """
    idle, frame, fault, answer = _Walk(), _Walk(), _Walk(), _Walk()
    with tempfile.TemporaryDirectory() as folder, virtual_time() as clock:
        rig = Rig(Path(folder), clock)
        see, wait = partial(rig.see, PERIOD), partial(rig.wait, PERIOD)

        def told() -> int:
            return len(rig.stage.tunnels(TUNNEL_SUMMARY))

        _until(lambda: told() > 2, see)
        with idle:
            for _ in range(_IDLE_TURNS):
                clock.now += STEP
                rig.turn()
        before = told()
        with frame:
            _until(lambda: told() > before, see)
        rig.hung = True
        with fault:
            _until(lambda: rig.stage.mode == HOLD, wait)
        rig.hung = False
        _until(lambda: rig.calls.call is not None, partial(see, "drum"))
        rig.word(0, "drum", 1.0, Motion.GO)
        with answer:
            _until(lambda: bool(rig.acks), wait)
        rig.kill()
    walks = {"frame to summary": frame, "answer to acknowledgement": answer, "fault to hold": fault}
    for name, walk in walks.items():
        if not walk.files - idle.files:
            raise RuntimeError(f"the walk from {name} has no file of its own: it was not counted")
    return {name: (len(walk.files), len(walk.files - idle.files), walk.moves) for name, walk in walks.items()}


def _until(done: Callable[[], bool], step: Callable[[], None]) -> None:
    for _ in range(_STEPS):
        if done():
            return
        step()
    raise RuntimeError(f"not done in {_STEPS} steps")


if __name__ == "__main__":
    sys.exit(main())
