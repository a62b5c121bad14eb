"""Reads a TOML file, so that each problem can be reported with its line."""

from __future__ import annotations

import re
import stat
import sys
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from anytraverse.regular_file import read_regular
from companion.config.toml_lines import KeyPath, key_lines
from companion.config.toml_mistakes import mistake
from companion.wire.packing import clean

_LONGEST_VALUE = 40


@dataclass(frozen=True)
class Problem:
    """One problem to correct. line: from 1, None for the whole file. key: such as "call.votes", may be empty.

    value: what may be shown of the value in the file, None for nothing.
    """

    file: Path
    line: int | None
    key: str
    value: object
    reason: str

    def __str__(self) -> str:
        place = str(self.file) if self.line is None else f"{self.file}:{self.line}"
        value = "" if self.value is None else f" = {_short(self.value)}"
        return clean(": ".join(part for part in (place, f"{self.key}{value}", self.reason) if part))


class ConfigError(Exception):
    """A configuration cannot be used; the message lists all its problems, one a line."""

    def __init__(self, problems: Sequence[Problem]) -> None:
        self.problems = tuple(problems)
        super().__init__("\n".join(str(problem) for problem in problems))


def _short(value: object) -> str:
    text = str(value).lower() if isinstance(value, bool) else repr(value)
    return text if len(text) <= _LONGEST_VALUE else f"{text[:_LONGEST_VALUE]}..."


if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

_LARGEST = 1 << 20
_AT_LINE = re.compile(r"^(.*?) \(at line (\d+), column \d+\)$", re.DOTALL)


class Layer:
    """One file that was read. Of several layers, the values of the first one win."""

    def __init__(
        self,
        path: Path,
        data: Mapping[str, Any],
        lines: Mapping[KeyPath, int],
        shown: Callable[[KeyPath, object], object],
        text: str = "",
    ) -> None:
        """shown: makes what a problem may show of the value at keys, None for nothing. text: of the file."""
        self.path = path
        self.data = data
        self.text = text
        self._lines = lines
        self._shown = shown

    @classmethod
    def read(cls, path: Path, shown: Callable[[KeyPath, object], object] = lambda *_: None) -> Layer:
        """Read a file. Raises ConfigError when it cannot be read or is no TOML. shown: as above."""
        try:
            return cls.parse(path, read_regular(path, _LARGEST + 1), shown)
        except FileNotFoundError:
            raise _file_error(path, "there is no such file: `companion init` writes one") from None
        except OSError as error:
            raise _file_error(path, f"cannot be read: {(error.strerror or str(error)).lower()}") from error

    @classmethod
    def parse(
        cls, path: Path, raw: bytes, shown: Callable[[KeyPath, object], object] = lambda *_: None
    ) -> Layer:
        """Read what stands in a file, or stood in one. Raises ConfigError when it is no TOML."""
        if len(raw) > _LARGEST:
            raise _file_error(path, "is larger than 1 MiB: this is no configuration")
        try:
            whole = raw.decode()
            text = whole.replace("\r\n", "\n")
            return cls(path, tomllib.loads(text), key_lines(text), shown, whole)
        except UnicodeDecodeError as error:
            raise _file_error(path, f"is not UTF-8 (byte {error.start}): save it as UTF-8") from error
        except RecursionError as error:
            raise _file_error(path, "is nested too deeply: this is no configuration") from error
        except tomllib.TOMLDecodeError as error:
            located = _AT_LINE.match(str(error))
            reason, line = (located[1], int(located[2])) if located else (str(error), None)
            key, instead = ("", "") if line is None else mistake(text.split("\n")[line - 1])
            if reason == "Cannot overwrite a value":
                instead = "it stands twice: keep one"
            why = instead or f"{reason}: mend the TOML"
            raise ConfigError([Problem(path, line, key if instead else "", None, why)]) from error

    def is_open_to_all(self) -> bool:
        """Whether users outside of the file's group may read it. Raises OSError."""
        return bool(self.path.stat().st_mode & stat.S_IROTH)

    def only(self, tables: Sequence[str], keys: Mapping[str, Sequence[str]]) -> Layer:
        """Return these whole tables, and of others these keys alone."""
        data = {name: value for name, value in self.data.items() if name in tables}
        for name, known in keys.items():
            if isinstance(found := self.data.get(name), Mapping):
                data[name] = {key: value for key, value in found.items() if key in known}
        return Layer(self.path, data, self._lines, self._shown)

    def problem(self, keys: KeyPath, reason: str) -> Problem:
        """Make a problem with the value at `keys`, on its line or that of the table around it."""
        around = (keys[:depth] for depth in range(len(keys), 0, -1))
        line = next((self._lines[key] for key in around if key in self._lines), None)
        return Problem(self.path, line, ".".join(keys), self._shown(keys, self.value(keys)), reason)

    def value(self, keys: KeyPath) -> object:
        """The value at `keys`; None when there is none."""
        found: Any = self.data
        for key in keys:
            found = found.get(key) if isinstance(found, Mapping) else None
        return found

    def table(self, name: str, problems: list[Problem]) -> Mapping[str, Any]:
        """The table `name`, empty when it is absent. A value that is no table is added to `problems`."""
        found = self.data.get(name, {})
        if isinstance(found, Mapping):
            return found
        problems.append(self.problem((name,), f"is a table: write [{name}] and its settings below it"))
        return {}


def nearest(name: str, known: Iterable[str]) -> str:
    """Suggest the known name that is most similar to `name`; list all known names when none is."""
    options = list(known)
    near = get_close_matches(name, options, 1)
    return f'did you mean "{near[0]}"?' if near else f"known are {', '.join(options)}"


def _file_error(path: Path, reason: str) -> ConfigError:
    return ConfigError([Problem(path, None, "", None, reason)])
