"""Reads the text file in which a user names the classes of a network, one a line."""

from __future__ import annotations

from pathlib import Path

from anytraverse.errors import BundleError, PreferencesError
from anytraverse.perception.classes.words import ClassWords, NamedClass
from anytraverse.preferences import clean_word
from anytraverse.regular_file import read_regular

_LARGEST = 1 << 20


def read_class_names(path: Path) -> ClassWords:
    """Read the classes from a text file, in the order of the network's outputs.

        # one class a line: its name, then its synonyms after commas
        grass, lawn, meadow
        - void

    "#" begins a comment; a line that begins with "-" is a class that is not a word.
    Raises BundleError, which names the line, and OSError.
    """
    classes = []
    for number, line in enumerate(_text(path).splitlines(), 1):
        entry = line.partition("#")[0].strip()
        if not entry:
            continue
        try:
            name, *synonyms = (clean_word(word) for word in entry.removeprefix("-").split(","))
        except PreferencesError as error:
            raise BundleError(f"{path}, line {number}: {error}") from None
        classes.append(NamedClass(name, tuple(synonyms), not entry.startswith("-")))
    try:
        return ClassWords(classes)
    except BundleError as error:
        raise BundleError(f"{path}: {error}") from None


def _text(path: Path) -> str:
    data = read_regular(path, _LARGEST + 1)
    try:
        if len(data) > _LARGEST:
            raise BundleError(
                f"{path} has more than {_LARGEST >> 20} MiB: give a text file, one class a line"
            )
        return data.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise BundleError(f"{path} is not a UTF-8 text file: give one, one class a line") from None
