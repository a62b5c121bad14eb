"""Defines the mutants: finds where one can be made, and changes one node of a file's syntax tree."""

from __future__ import annotations

import ast
import copy
import random
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]

_ALGORITHM = ("tests/anytraverse",)
_GUIDE = ("tests/companion/guide",)
_CALLS = ("tests/companion/calls",)
_DAEMON = ("tests/companion/daemon",)
_HOLD_GIVEN = ("tests/companion/daemon/test_hold_that_cannot_be_given.py", *_DAEMON)
_VISION = ("tests/companion/vision",)
_LINK = ("tests/companion/link",)


def _tests(folder: str, *names: str) -> tuple[str, ...]:
    return tuple(f"tests/companion/{folder}/test_{name}.py" for name in names)


_ANSWERS = _tests("link", "answers", "answers_by_parameter", "words_by_text")
_ROUTES = _tests(
    "link", "message_intervals", "several_connections", "one_sender", "vehicle", "commands", "camera"
)
_SIGNED = (*_tests("wire", "signing"), *_tests("link", "signed_link"))
_JOURNAL = (
    *_tests("storage", "journal_calls", "journal_of_version_1", "journal_trouble", "journal_memory"),
    *_tests("storage", "journal_salvaged", "journal_copy"),
)
SAFETY_PATH: Mapping[str, tuple[str, ...]] = {
    "anytraverse/answers.py": _ALGORITHM,
    "anytraverse/findings.py": _ALGORITHM,
    "anytraverse/judging.py": _ALGORITHM,
    "anytraverse/roi.py": _ALGORITHM,
    "anytraverse/engine.py": _ALGORITHM,
    "companion/calls/answered_things.py": _CALLS,
    "companion/guide/rules.py": _GUIDE,
    "companion/calls/call_rules.py": _CALLS,
    "companion/calls/cover.py": _CALLS,
    "companion/calls/faults.py": ("tests/companion/calls/test_a_fault_is_driven_over.py",),
    "companion/calls/hold.py": _CALLS,
    "companion/calls/hold_rules.py": _CALLS,
    "companion/calls/machine.py": _CALLS,
    "companion/calls/mode_monitor.py": ("tests/companion/calls/test_a_completed_mission.py", *_CALLS),
    "companion/calls/policy.py": (*_CALLS, *_DAEMON),
    "companion/calls/reason_filter.py": _CALLS,
    "companion/calls/snapshot.py": (*_CALLS, *_DAEMON),
    "companion/calls/thing.py": _CALLS,
    "companion/calls/tracking.py": (*_tests("calls", "masks_grow"), *_CALLS),
    "companion/daemon/policy/service.py": _HOLD_GIVEN,
    "companion/daemon/policy/hold_gate.py": _HOLD_GIVEN,
    "companion/config/whole_check.py": _HOLD_GIVEN,
    "companion/config/stopping.py": ("tests/companion/desk/check", *_DAEMON),
    "companion/vehicle/brakes.py": ("tests/companion/desk/check", *_DAEMON),
    "companion/vehicle/course.py": ("tests/companion/vehicle",),
    "companion/daemon/call_frames.py": _DAEMON,
    "companion/daemon/call_texts.py": _DAEMON,
    "companion/daemon/executor.py": _DAEMON,
    "companion/daemon/health.py": _DAEMON,
    "companion/daemon/persistence.py": _DAEMON,
    "companion/daemon/answers/handler.py": (*_CALLS, *_DAEMON),
    "companion/daemon/answers/outcome.py": (*_CALLS, *_DAEMON),
    "companion/vision/checks.py": _VISION,
    "companion/vision/client.py": _VISION,
    "companion/vision/measured_pace.py": ("tests/companion/vision/test_measured_pace.py",),
    "companion/system/watchdog.py": _VISION,
    "companion/vision/freeze_detector.py": (*_DAEMON, *_VISION),
    "companion/link/vehicle.py": _LINK,
    "companion/link/setpoints_and_intervals.py": _LINK,
    "companion/link/access_control.py": _LINK,
    "companion/link/mode_commands.py": _tests("link", "mode_commands", "vehicle"),
    "companion/link/dead_man.py": _tests("link", "dead_man"),
    "companion/link/streams.py": _tests("link", "streams", "stuck_devices"),
    "companion/storage/writer.py": _tests("daemon", "the_writer"),
    "companion/storage/journal.py": _JOURNAL,
    "companion/link/answer_store.py": ("tests/companion/daemon/answers", *_ANSWERS),
    "companion/link/answers.py": (*_ANSWERS, *_tests("link", "camera")),
    "companion/link/router.py": (*_ANSWERS, *_ROUTES),
    "companion/link/reassembly.py": _ANSWERS,
    "companion/link/limits.py": _tests("link", "bucket", "floods_of_requests", "floods_under_many_names"),
    "companion/link/signing.py": _SIGNED,
    "companion/wire/answers.py": (*_tests("wire", "payloads"), *_ANSWERS),
    "companion/wire/signing.py": _SIGNED,
    "companion/wire/signing_store.py": (*_tests("wire", "signing_store"), *_SIGNED),
    "companion/calls/decisions.py": _tests("calls", "when_a_call_opens", "answers_to_a_call", "the_way_back"),
    "companion/vision/answer_queue.py": _tests("vision", "answer_queue"),
    "companion/vision/codec.py": _tests("vision", "codec"),
    "companion/vision/evidence.py": _tests("vision", "evidence_of_ok"),
    "companion/vision/exposure.py": _tests("vision", "exposure"),
    "companion/vision/judging_rate.py": _tests("vision", "judging_rate"),
    "companion/system/child_process.py": _tests("system", "child_process", "socket_units"),
    "companion/system/socket_units.py": _tests("system", "socket_units"),
}
"""File -> the tests that must notice a fault in it, the likeliest first."""

_OPPOSITES: Mapping[type[ast.cmpop], type[ast.cmpop]] = {
    ast.Lt: ast.GtE,
    ast.LtE: ast.Gt,
    ast.Gt: ast.LtE,
    ast.GtE: ast.Lt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.Is: ast.IsNot,
    ast.IsNot: ast.Is,
    ast.In: ast.NotIn,
    ast.NotIn: ast.In,
}
_BOUNDARIES: Mapping[type[ast.cmpop], type[ast.cmpop]] = {
    ast.Lt: ast.LtE,
    ast.LtE: ast.Lt,
    ast.Gt: ast.GtE,
    ast.GtE: ast.Gt,
}
KINDS = (
    "comparison",
    "junction",
    "negation",
    "truth",
    "condition",
    "return",
    "boundary",
    "operand",
    "assignment",
)


@dataclass(frozen=True)
class Mutant:
    """One fault. function: qualified name. line: the source there, or a part of it.

    nth: of the places of this kind in such lines of the function, from 0.
    """

    file: str
    function: str
    kind: str
    nth: int
    line: str

    def figures(self) -> dict[str, Any]:
        """As JSON values."""
        return asdict(self)

    def source(self) -> str:
        """The file with the fault. Raises LookupError where the function or the place is gone."""
        source = (ROOT / self.file).read_text()
        lines, tree = source.splitlines(), ast.parse(source)
        functions = dict(_functions(tree))
        if self.function not in functions:
            raise LookupError(f"{self.file} has no function {self.function} any more")
        found = _places(functions[self.function], self.kind)
        places = [node for node in found if self.line in lines[node.lineno - 1]]
        if self.nth >= len(places):
            raise LookupError(f"{self.file}: {self.function} has no {self.kind} {self.nth} any more")
        _break(places[self.nth], self.kind)
        return ast.unparse(ast.fix_missing_locations(tree)) + "\n"


def chosen(
    count: int, seed: int, files: Iterable[str] = SAFETY_PATH, without: Collection[Mutant] = ()
) -> list[Mutant]:
    """So many of all that can be made, by turns from each file, without repetition and those in `without`."""
    chance = random.Random(seed)
    left = {file: [one for one in _mutants(file) if one not in without] for file in files}
    for found in left.values():
        chance.shuffle(found)
    picked: list[Mutant] = []
    while len(picked) < count and any(left.values()):
        picked += [found.pop() for found in left.values() if found]
    return picked[:count]


def _mutants(file: str) -> Iterator[Mutant]:
    source = (ROOT / file).read_text()
    lines = source.splitlines()
    for name, function in _functions(ast.parse(source)):
        for kind in KINDS:
            earlier: list[str] = []
            for node in _places(function, kind):
                line = lines[node.lineno - 1].strip()
                yield Mutant(file, name, kind, sum(line in one for one in earlier), line)
                earlier.append(line)


def _functions(tree: ast.AST, before: str = "") -> Iterator[tuple[str, ast.FunctionDef]]:
    for node in ast.iter_child_nodes(tree):
        if isinstance(node, ast.FunctionDef):
            yield before + node.name, node
        if isinstance(node, ast.ClassDef | ast.FunctionDef):
            yield from _functions(node, f"{before}{node.name}.")


def _places(function: ast.FunctionDef, kind: str) -> list[ast.stmt | ast.expr]:
    """Where a fault of this kind can be made in it."""
    nodes = (node for node in _own_nodes(function) if isinstance(node, ast.stmt | ast.expr))
    return [node for node in nodes if _fits(node, kind)]


def _own_nodes(function: ast.FunctionDef) -> Iterator[ast.AST]:
    """Of its body, without those of functions inside it and of annotations."""
    waiting: list[ast.AST] = list(reversed(function.body))
    while waiting:
        node = waiting.pop()
        yield node
        if not isinstance(node, ast.FunctionDef):
            waiting += reversed(list(ast.iter_child_nodes(node)))


def _fits(node: ast.AST, kind: str) -> bool:
    match kind, node:
        case "comparison", ast.Compare():
            return True
        case "junction", ast.BoolOp():
            return True
        case "negation", ast.UnaryOp(op=ast.Not()):
            return True
        case "truth", ast.Constant(value=bool()):
            return True
        case "condition", ast.If():
            return True
        case "return", ast.Return(value=ast.expr()):
            return not isinstance(node.value, ast.Constant)
        case "boundary", ast.Compare():
            return type(node.ops[0]) in _BOUNDARIES
        case "operand", ast.BoolOp():
            return True
        case "assignment", ast.Assign(value=ast.BoolOp() | ast.Compare()):
            return True
    return False


def _break(node: ast.AST, kind: str) -> None:
    """Compare the other way, swap and with or, drop a not, swap true with false, never take a branch,
    return nothing, move a boundary by itself, drop the last operand of and/or, or assign False.
    """
    match kind, node:
        case "comparison", ast.Compare():
            node.ops[0] = _OPPOSITES[type(node.ops[0])]()
        case "junction", ast.BoolOp():
            node.op = ast.Or() if isinstance(node.op, ast.And) else ast.And()
        case "negation", ast.UnaryOp():
            inner = copy.deepcopy(node.operand)
            node.op, node.operand = ast.Not(), ast.UnaryOp(op=ast.Not(), operand=inner)
        case "truth", ast.Constant():
            node.value = not node.value
        case "condition", ast.If():
            node.test = ast.Constant(value=False)
        case "return", ast.Return():
            node.value = ast.Constant(value=None)
        case "boundary", ast.Compare():
            node.ops[0] = _BOUNDARIES[type(node.ops[0])]()
        case "operand", ast.BoolOp():
            node.values.pop()
        case "assignment", ast.Assign():
            node.value = ast.Constant(value=False)
