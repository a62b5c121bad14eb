"""One TOML file: its data, and where in it each key stands."""

from __future__ import annotations

import re
import sys
from collections.abc import Iterable, Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import Any

from companion.config.errors import ConfigError, Problem
from companion.config.lines import KeyPath, key_lines

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

_LARGEST = 1 << 20
_AT_LINE = re.compile(r"^(.*?) \(at line (\d+), column \d+\)$", re.DOTALL)


class Layer:
    """A file that was read. Of two layers the first one's values win."""

    def __init__(self, path: Path, data: Mapping[str, Any], lines: Mapping[KeyPath, int]) -> None:
        self.path = path
        self.data = data
        self._lines = lines

    @classmethod
    def read(cls, path: Path) -> Layer:
        """Raises ConfigError when the file cannot be read or is no TOML."""
        try:
            with path.open("rb") as file:
                raw = file.read(_LARGEST + 1)
            if len(raw) > _LARGEST:
                raise _whole(path, "is larger than 1 MiB: this is no configuration")
            text = raw.decode().replace("\r\n", "\n")
            return cls(path, tomllib.loads(text), key_lines(text))
        except FileNotFoundError:
            raise _whole(path, "there is no such file: `companion init` writes one") from None
        except OSError as error:
            raise _whole(path, f"cannot be read: {(error.strerror or str(error)).lower()}") from error
        except UnicodeDecodeError as error:
            raise _whole(path, f"is not UTF-8 (byte {error.start}): save it as UTF-8") from error
        except RecursionError as error:
            raise _whole(path, "is nested too deeply: this is no configuration") from error
        except tomllib.TOMLDecodeError as error:
            located = _AT_LINE.match(str(error))
            reason, line = (located[1], int(located[2])) if located else (str(error), None)
            hint = " (text stands in quotes)" if reason == "Invalid value" else ""
            raise ConfigError([Problem(path, line, "", None, f"{reason}{hint}: mend the TOML")]) from error

    def problem(self, keys: KeyPath, reason: str) -> Problem:
        """A problem with what stands under `keys`, on its line or that of the table around it."""
        around = (keys[:depth] for depth in range(len(keys), 0, -1))
        line = next((self._lines[key] for key in around if key in self._lines), None)
        value = self.value(keys)
        return Problem(self.path, line, ".".join(keys), None if isinstance(value, Mapping) else value, reason)

    def value(self, keys: KeyPath) -> object:
        """What stands under `keys`; None for nothing."""
        found: Any = self.data
        for key in keys:
            found = found.get(key) if isinstance(found, Mapping) else None
        return found

    def table(self, name: str, problems: list[Problem]) -> Mapping[str, Any]:
        """The table `name`, empty when it is absent or, which is a problem, no table."""
        found = self.data.get(name, {})
        if isinstance(found, Mapping):
            return found
        problems.append(self.problem((name,), f"is a table: write [{name}] and its settings below it"))
        return {}


def nearest(name: str, known: Iterable[str]) -> str:
    """ "; did you mean ...?" when something is near, else the choice."""
    options = list(known)
    near = get_close_matches(name, options, 1)
    return f'did you mean "{near[0]}"?' if near else f"known are {', '.join(options)}"


def _whole(path: Path, reason: str) -> ConfigError:
    return ConfigError([Problem(path, None, "", None, reason)])
