"""A row of the fault table: configurations that were damaged or mistyped."""

from __future__ import annotations

import contextlib
import io
import math
import re
import shutil
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from random import Random
from typing import Any

from anytraverse.preferences import clean_word
from bench.faults.row import Row, RowOutcome, Work
from companion.cli import main
from companion.config import Config, load_config
from companion.config.toml_file import Layer

CONFIGS = 200
_SHIPPED = Path(__file__).parents[2] / "config"
_COMMENTED = re.compile(r'^# (\[[a-z]+\]|"?[a-z][a-z _]*"? = .+)$', re.MULTILINE)
_ELSEWHERE = ("vocabulary", "signing_key", "calibration", "[aliases]", '"very long grass"', "pixel_format")
"""What the shipped file shows in a comment and cannot just be taken out of it."""
_VALUE = re.compile(r'^("?[a-z][a-z _]*"?) = (.+)$', re.MULTILINE)
_RUBBISH = (
    *('""', '"x"', '"\\u0007"', '"off"', '"1"', '"' + "a" * 5000 + '"', "true", "false", "nan", "-nan"),
    *("inf", "-inf", "1e999", "-1e308", "0", "-1", "0.5", "1", "2", "1e9", "99999999999999999999999"),
    *("[]", "[1]", "[300, 400]", "[[1]]", "{}", "{a = 1}", "2026-11-22", "12:00:00", "0x10", "'''\n'''"),
    *("nine", "1,5", "1.0.0", "+", "# nothing", '"tcp:999.1.1.1:1"', '"serial::"', '"udpin:127.0.0.1:70000"'),
)
_PLACED = re.compile(r"^(?:companion \w+: )?.*\.toml(?::\d+)?: .+")


def shipped() -> str:
    """The shipped configuration, with the settings that it shows in comments."""
    text = (_SHIPPED / "companion.toml").read_text(encoding="utf-8").replace('"builtin"', '"builtin:lexicon"')
    return _COMMENTED.sub(lambda found: found[0] if found[1].startswith(_ELSEWHERE) else found[1], text)


def mutated(text: str, chance: Random, kind: int) -> bytes:
    """Mutate a configuration. kind: 0 bytes, 1 lines, 2 values of a wrong type or range."""
    if kind == 2:
        found = chance.choice(list(_VALUE.finditer(text)))
        return f"{text[: found.start(2)]}{chance.choice(_RUBBISH)}{text[found.end(2) :]}".encode()
    if kind == 1:
        lines = text.split("\n")
        # Mostly lines that say something: a comment that moves is no fault.
        said = [number for number, line in enumerate(lines) if line and not line.startswith("#")]
        one, other = chance.choice(said), chance.choice(said)
        match chance.randrange(4):
            case 0:
                del lines[one]
            case 1:
                lines.insert(other, lines[one])
            case 2:
                lines[one], lines[other] = lines[other], lines[one]
            case _:
                lines[one] = lines[one][: chance.randrange(len(lines[one]) + 1)]
        return "\n".join(lines).encode()
    content = bytearray(text.encode())
    for _ in range(chance.randrange(1, 4)):
        at = chance.randrange(len(content))
        match chance.randrange(4):
            case 0:
                content[at] = chance.randrange(256)
            case 1:
                content.insert(at, chance.randrange(256))
            case 2:
                del content[at : at + chance.randrange(1, 40)]
            case _:
                content[at] ^= 1 << chance.randrange(8)
    return bytes(content)


def checked(path: Path) -> tuple[int, str]:
    """Run `companion config check`; return its exit code, and what it wrote to stderr or an exception."""
    output, errors = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(output), contextlib.redirect_stderr(errors):
        try:
            code = main(["config", "check", str(path)])
        except BaseException as error:  # argparse would raise SystemExit: that is wrong, too
            return -1, f"{type(error).__name__}: {error}"
    return code, errors.getvalue()


def wrong_with(path: Path) -> tuple[bool, str]:
    """Check one file: whether it was accepted, and what is wrong with how it was taken, "" for nothing."""
    code, said = checked(path)
    if code == 0:
        return True, _not_understood(path)
    progress = ("companion config: loading ", "companion config: \n")
    lines = [line for line in said.splitlines() if line and not f"{line}\n".startswith(progress)]
    unplaced = [line for line in lines if not _PLACED.match(line)]
    if code != 2 or not lines or unplaced:
        return False, f"exit code {code}: {said[:300]}"
    return False, ""


def _not_understood(path: Path) -> str:
    """Name what stands in an accepted file and is not in force so; "" for nothing."""
    config, data = load_config(path), Layer.read(path).data
    for name, given in data.items():
        if name == "words":
            if dict(config.words) != {clean_word(word): float(weight) for word, weight in given.items()}:
                return f"words are {config.words}, given were {given}"
        elif name == "vocabulary":
            if not {clean_word(word) for word in given} <= set(config.vocabulary):
                return f"vocabulary is {config.vocabulary}, given was {given}"
        elif name != "aliases":
            differing = _differing(config, name, given)
            if differing:
                return differing
    return ""


def _differing(config: Config, name: str, given: Mapping[str, Any]) -> str:
    section = getattr(config, name)
    for key, value in given.items():
        taken = getattr(section, key)
        if isinstance(value, bool) or isinstance(taken, bool):
            same = taken is value
        elif isinstance(value, int | float):
            same = math.isfinite(value) and taken == value
        elif isinstance(value, list):
            same = list(taken) == value
        elif isinstance(value, str):  # a path is in force as an absolute one
            same = taken == value or Path(str(taken)).name == Path(value).name
        else:
            same = key == "more"
        if not same:
            return f"{name}.{key} = {taken!r}, given was {value!r}"
    return ""


def _produce(work: Work) -> RowOutcome:
    shutil.copytree(_SHIPPED / "vehicles", work.folder / "vehicles")
    text, wrong, accepted, run = shipped(), list[str](), 0, 0
    path = work.folder / "companion.toml"
    path.write_text(text, encoding="utf-8")
    whole = wrong_with(path)
    if whole != (True, ""):
        return RowOutcome(0, (f"the file is wrong before anything is changed: {whole[1]}",))
    count = 20 if work.short else CONFIGS
    for number in range(count):
        content = mutated(text, Random(f"{work.seed} {number}"), number % 3)
        path.write_bytes(content)
        taken, why = wrong_with(path)
        accepted += taken
        if why:
            wrong.append(f"configuration {number}: {why}")
        if not taken and run < (1 if work.short else 20):
            run += 1
            wrong += _refused_by_daemon(path, number)
    saw = f"{accepted} valid, taken as they stand; {count - accepted} refused, {run} also by the daemon"
    return RowOutcome(count, tuple(wrong), saw=saw)


def _refused_by_daemon(path: Path, number: int) -> list[str]:
    """Start the daemon with a configuration that is refused."""
    command = [sys.executable, "-m", "companion", "run", str(path)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60.0, check=False)
    if done.returncode == 2 and "Traceback" not in done.stderr and done.stderr.startswith("companion run: "):
        return []
    return [f"configuration {number}: the daemon ended with {done.returncode}: {done.stderr[-300:]}"]


ROWS = (
    Row(
        "damaged configuration",
        f"{CONFIGS} mutations of the shipped file: bytes, lines, and values of a wrong type or range",
        "taken where valid, else refused with the line",
        _produce,
    ),
)
