"""Writes answered scenes to one file, and reads them on another rover with the same model.

The file has one JSON value a line: a header, the vectors of tapped examples, then the scenes, which refer to
the vectors by their number. All that is read is checked: the file may come from anywhere.
"""

from __future__ import annotations

import base64
import binascii
import json
import math
import os
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from anytraverse.answers import MAX_EXAMPLES
from anytraverse.errors import AnyTraverseError
from anytraverse.history import MAX_REFUSED, Embedding, Entry, Place, is_embedding
from anytraverse.perception import Example, Perceiver
from anytraverse.picture_size import jpeg_size
from anytraverse.preferences import MAX_WORDS, Preferences, Setting
from anytraverse.regular_file import open_regular
from anytraverse.release import own_version
from anytraverse.synonyms import refuse_contradictions
from companion.config.schema import MOST_SCENES
from companion.storage.journal import LARGEST
from companion.system.atomic_write import write_durably

FORMAT, VERSION = "anytraverse memory", 1
MAX_VECTORS = 100_000
MAX_PICTURE = 256 << 10
"""Bytes of one picture."""
MAX_PICTURES = 32 << 20
"""Bytes of all pictures together. Those of the newest scenes are exported first."""
MAX_LINE = 1 << 20
MAX_FILE = 2 * LARGEST
"""Bytes: the whole journal in base64, and the pictures, fit."""
_MAX_SIDE = 4096
"""Pixels of a picture's width or height."""
_FLOATS = np.dtype("<f4")
_PLACE = {"latitude": 90.0, "longitude": 360.0, "heading": 360.0, "time": 4_102_444_800.0}
"""Figure of a place -> its greatest absolute value."""


class SceneFileError(Exception):
    """The file cannot be used. The text says why, and what to do."""


@dataclass(frozen=True)
class Scene:
    """Holds a scene and its picture, JPEG, b"" without one."""

    entry: Entry
    picture: bytes = b""


@dataclass(frozen=True)
class ExpectedModel:
    """Says which scenes fit this rover's model: its id, and the lengths of its vectors; 0: it has none."""

    perceiver: Perceiver
    embedding: int
    example: int
    surroundings: int


def write_scenes(path: Path, model_id: str, scenes: list[Scene]) -> int:
    """Write a new file, and return how many pictures did not fit. Raises OSError, SceneFileError."""
    if path.exists():
        raise SceneFileError(f"{path} is there already: name another file, or delete it")
    vectors: dict[bytes, int] = {}
    lines, room, left_out = list[bytes](), MAX_PICTURES, 0
    for scene in reversed(scenes):
        picture = scene.picture
        if len(picture) > min(room, MAX_PICTURE):
            picture, left_out = b"", left_out + 1
        room -= len(picture)
        lines.append(_line(_record(scene.entry, model_id, vectors, picture)))
    header = {
        "format": FORMAT,
        "version": VERSION,
        "model": model_id,
        "written_by": own_version(),
        "vectors": len(vectors),
        "scenes": len(scenes),
    }
    rows = [_line(header), *(_line(_encoded(vector)) for vector in vectors), *reversed(lines)]
    write_durably(path, b"".join(rows))
    return left_out


def read_scenes(path: Path, expected: ExpectedModel) -> list[Scene]:
    """Read and check a file. Raises OSError, and SceneFileError for anything that this rover cannot use."""
    with os.fdopen(open_regular(path), "rb") as file:
        if os.fstat(file.fileno()).st_size > MAX_FILE:
            raise SceneFileError(f"{path} is larger than {MAX_FILE >> 20} MiB: nothing is imported")
        try:
            return _read(file, expected)
        except (ValueError, TypeError, RecursionError, AnyTraverseError) as error:
            raise SceneFileError(f"{path}: {error}: nothing is imported") from error


def _record(entry: Entry, model_id: str, vectors: dict[bytes, int], picture: bytes) -> dict[str, Any]:
    place = entry.place
    examples = {
        word: [
            vectors.setdefault(_bytes(one.vector), len(vectors))
            for one in of_word
            if one.model_id == model_id
        ]
        for word, of_word in entry.examples.items()
    }
    return {
        "embedding": _encoded(_bytes(entry.embedding)),
        "words": dict(entry.preferences),
        "examples": {word: numbers for word, numbers in examples.items() if numbers},
        "place": {name: getattr(place, name) for name in _PLACE if getattr(place, name) is not None},
        "attitude": place.attitude,
        "call": entry.call_id,
        "picture": _encoded(picture) if picture else None,
        **({"refused": [_encoded(_bytes(one)) for one in entry.refused]} if entry.refused else {}),
        **({} if entry.surroundings is None else {"surroundings": _encoded(_bytes(entry.surroundings))}),
    }


def _read(file: BinaryIO, expected: ExpectedModel) -> list[Scene]:
    header = _table(_next(file, 1), "the header")
    if header.get("format") != FORMAT:
        raise ValueError("is no file of `companion memory export`")
    if header.get("version") != VERSION:
        raise ValueError(
            f"was written in version {_shown(header.get('version'))} of the format, and this companion reads "
            f"{VERSION}: install a companion that is as new as the one that wrote it"
        )
    model = expected.perceiver.model_id
    if header.get("model") != model:
        raise ValueError(
            f"was learnt with model {_shown(header.get('model'))}, and this rover runs {model}: scenes of "
            "two models cannot be compared. Set [perceiver] name to the same model on both"
        )
    vectors = _count(header.get("vectors"), MAX_VECTORS, "vectors")
    scenes = _count(header.get("scenes"), MOST_SCENES, "scenes")
    examples = [
        Example(model, _vector(_next(file, number + 2), expected.example)) for number in range(vectors)
    ]
    found = list(_scenes(file, scenes, vectors + 2, examples, expected))
    if file.read(1):
        raise ValueError(f"goes on after the {scenes} scenes that its header names")
    return found


def _scenes(
    file: BinaryIO, count: int, first_line: int, examples: list[Example], expected: ExpectedModel
) -> Iterator[Scene]:
    for number in range(count):
        line = first_line + number
        row = _table(_next(file, line), "a scene")
        try:
            yield _scene(row, examples, expected)
        except (ValueError, TypeError, AnyTraverseError) as error:
            raise ValueError(f"line {line}: {error}") from error


def _scene(row: Mapping[str, Any], examples: list[Example], expected: ExpectedModel) -> Scene:
    embedding = _vector(row.get("embedding"), expected.embedding)
    if not is_embedding(embedding):
        raise ValueError("an embedding is zero")
    words = _table(row.get("words"), "words")
    if len(words) > MAX_WORDS:
        raise ValueError(f"{len(words)} words, and at most {MAX_WORDS} can be in use")
    preferences = Preferences({word: Setting(_number(weight, 1.0)) for word, weight in words.items()})
    refuse_contradictions(preferences, expected.perceiver.meaning)
    taps = _table(row.get("examples"), "examples")
    if not set(taps) <= set(preferences):
        raise ValueError("examples of a word that the scene does not have")
    entry = Entry(
        embedding,
        preferences,
        order=0,
        matched=0,
        call_id=_count(row.get("call"), 0xFFFF, "call"),
        examples={word: tuple(_taps(numbers, examples)) for word, numbers in taps.items()},
        place=_place(row.get("place"), row.get("attitude")),
        refused=tuple(_refused(row.get("refused", []), expected.embedding)),
        surroundings=(
            _vector(row["surroundings"], expected.surroundings) if row.get("surroundings") else None
        ),
    )
    return Scene(entry, _picture(row.get("picture")))


def _taps(numbers: object, examples: list[Example]) -> Iterator[Example]:
    if not isinstance(numbers, list) or not 0 < len(numbers) <= MAX_EXAMPLES:
        raise ValueError(f"a word has 1 to {MAX_EXAMPLES} examples")
    for number in numbers:
        yield examples[_count(number, len(examples) - 1, "examples")]


def _refused(vectors: object, length: int) -> Iterator[Embedding]:
    if not isinstance(vectors, list) or len(vectors) > MAX_REFUSED:
        raise ValueError(f"a scene has at most {MAX_REFUSED} refused frames")
    for vector in vectors:
        yield _vector(vector, length)


def _place(figures: object, angles: object) -> Place:
    table = _table(figures, "a place")
    latitude, longitude, heading, at = (
        None if table.get(name) is None else _number(table[name], most) for name, most in _PLACE.items()
    )
    if angles is None:
        return Place(latitude, longitude, heading, at)
    if not isinstance(angles, list) or len(angles) != 3:
        raise ValueError("an attitude is roll, pitch and yaw")
    roll, pitch, yaw = (_number(angle, 360.0) for angle in angles)
    return Place(latitude, longitude, heading, at, (roll, pitch, yaw))


def _picture(value: object) -> bytes:
    if value is None:
        return b""
    content = _decoded(value, MAX_PICTURE)
    size = jpeg_size(content)
    if size is None or not 0 < min(size) <= max(size) <= _MAX_SIDE:
        raise ValueError(f"a picture is no JPEG of at most {_MAX_SIDE} x {_MAX_SIDE} pixels")
    return content


def _next(file: BinaryIO, line: int) -> Any:
    text = file.readline(MAX_LINE + 1)
    if not text.endswith(b"\n"):
        why = (
            f"is longer than {MAX_LINE} bytes" if len(text) > MAX_LINE else "is cut off: copy the file again"
        )
        raise ValueError(f"line {line} {why}")
    try:
        return json.loads(text, parse_constant=_refuse_constant)
    except ValueError as error:
        raise ValueError(f"line {line} is no JSON ({str(error)[:80]})") from error


def _refuse_constant(name: str) -> float:
    raise ValueError(f"{name} is no number")


def _table(value: object, what: str) -> Mapping[str, Any]:
    if not isinstance(value, dict):
        raise ValueError(f"{what}: not an object")
    return value


def _count(value: object, most: int, what: str) -> int:
    if not isinstance(value, int) or isinstance(value, bool) or not 0 <= value <= most:
        raise ValueError(f"{what}: {_shown(value)} is not 0 to {most}")
    return value


def _number(value: object, most: float) -> float:
    """Return a number as float. Raises ValueError unless it is finite, and at most `most` either way."""
    if isinstance(value, bool) or not isinstance(value, int | float):
        raise ValueError(f"{_shown(value)} is no number")
    number = float(value) if abs(value) <= most else math.nan
    if not math.isfinite(number):
        raise ValueError(f"{_shown(value)} is not {-most:g} to {most:g}")
    return number


def _shown(value: object) -> str:
    text = repr(value)
    return text if len(text) <= 60 else f"{text[:60]}..."


def _vector(value: object, length: int) -> Embedding:
    content = _decoded(value, 4 * length)
    if len(content) != 4 * length:
        raise ValueError(f"a vector has {len(content)} bytes, and this model's have {4 * length}")
    vector = np.frombuffer(content, _FLOATS).astype(np.float32)
    if not np.isfinite(vector).all():
        raise ValueError("a vector is not finite")
    return vector


def _decoded(value: object, most: int) -> bytes:
    if not isinstance(value, str) or len(value) > 4 * (most // 3 + 1):
        raise ValueError(f"not a text of base64 of at most {most} bytes")
    try:
        return base64.b64decode(value, validate=True)
    except (binascii.Error, ValueError) as error:
        raise ValueError(f"not base64 ({error})") from error


def _encoded(content: bytes) -> str:
    return base64.b64encode(content).decode()


def _bytes(vector: Embedding) -> bytes:
    return np.ascontiguousarray(vector, _FLOATS).tobytes()


def _line(value: object) -> bytes:
    return json.dumps(value, separators=(",", ":"), allow_nan=False).encode() + b"\n"
