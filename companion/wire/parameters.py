"""Defines the parameters of the companion: names of at most 16 characters, fixed while it runs. Packs them.

No autopilot uses the prefix AT_. That matters, because ArduPilot executes a request for component 191 itself
until it has received a message of that component.
"""

from __future__ import annotations

import math
import re
import struct
import unicodedata
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from urllib.parse import parse_qsl

from companion.wire.ids import OTHER_PLACE, Policy
from companion.wire.messages import MESSAGES

MAX_NAME = 16
MAX_WORDS = 24
MAX_PARAMETERS = 48
NOT_IN_USE = -2.0
"""The value of a word's weight, or of the tile threshold, that is not in use."""

THR_ROI = "AT_THR_ROI"
THR_SCENE = "AT_THR_SCENE"
THR_TILE = "AT_THR_TILE"
THR_TRAV = "AT_THR_TRAV"
POLICY = "AT_POLICY"
ROI: Mapping[str, str] = MappingProxyType(
    {"left": "AT_ROI_L", "top": "AT_ROI_T", "right": "AT_ROI_R", "bottom": "AT_ROI_B"}
)
"""Side of the region of interest -> its parameter, a fraction of the image's width or height."""
SUMMARY_RATE = "AT_SUM_HZ"
NUMBER_RATE = "AT_NUM_HZ"
"""Summaries per second, and messages per second of each number; 0: none."""
BUDGET = "AT_BUDGET"
"""B/s of unsolicited traffic on the first connection."""
ANSWER = "AT_ANSWER"
"""An answer without words: id of the call or hold x 10 + `Motion`; id 0 is the current one. Or the call whose
place matched x 10 + 4: it is another place. It reads as 0."""
TAP_WORD = "AT_TAP_WORD"
"""Index of the word's parameter that the next tap in the video names, -1: an obstacle. A tap resets it."""
OBSTACLE = ("obstacle", -1.0)
"""Word and weight of a tap for which no other word was chosen."""
WORDS_TEXT = "AT_WORDS"
"""All words with their weights as one text; only in the extended parameter protocol."""
SHADOW_HOLDS = "AT_SHD_HOLDS"
"""Number of would-be holds in shadow policy. Setting it to 0 resets all the shadow counts."""
SHADOW_HOURS = "AT_SHD_HOURS"
"""Hours over which they were counted."""
SHADOW_REASONS: Mapping[str, str] = MappingProxyType(
    {
        "unknown_scene": "AT_SHD_SCENE",
        "unknown_object": "AT_SHD_OBJECT",
        "blocked": "AT_SHD_BLOCKED",
        "fault": "AT_SHD_FAULT",
    }
)
"""Reason -> the parameter with the number of would-be holds that began for it."""
WORD_PREFIX = "AT_W_"
_ROOM = MAX_NAME - len(WORD_PREFIX)
_ALIAS = re.compile(r"[A-Z0-9_]+")
_NO_ALIASES: Mapping[str, str] = MappingProxyType({})
# The file of all parameters, in the format of ArduPilot's `@PARAM/param.pck`, little-endian: README.md and
# AP_Filesystem_Param.cpp of its libraries/AP_Filesystem. ArduPilot pads with zeros, so that no value crosses
# a block. We do not: our file does not change while it is read.
MAGIC = 0x671B
MAGIC_WITH_DEFAULTS = 0x671C
_HEAD = struct.Struct("<HHH")
_FLOAT = 4
_HAS_DEFAULT = 1 << 4
_MOST_IN_COMMON = 15
_LAST = 0xFFFE
_DIGITS = 6
"""Decimal places of a value; values that differ only behind them are equal."""


class ParameterError(ValueError):
    """A vocabulary, name or value is not possible as parameters; the message says why."""


@dataclass(frozen=True)
class Parameter:
    """One parameter (REAL32). It accepts [minimum, maximum] and `special`; whole numbers only if `whole`.

    word: the word that the value is the weight of, None for settings.
    """

    name: str
    value: float
    minimum: float
    maximum: float
    special: float | None = None
    whole: bool = False
    read_only: bool = False
    word: str | None = None

    def accepts(self, value: float) -> bool:
        """Whether `value` is finite and in the allowed range."""
        if not math.isfinite(value):
            return False
        if self.special is not None and value == self.special:
            return True
        return self.minimum <= value <= self.maximum and not (self.whole and value != int(value))

    def allowed(self) -> str:
        """Format the range for a person: "0 to 1 or -2"."""
        special = "" if self.special is None else f" or {self.special:g}"
        return f"{self.minimum:.9g} to {self.maximum:.9g}{special}"


_SETTINGS = (
    Parameter(THR_ROI, 0.3, 0.0, 1.0),
    Parameter(THR_SCENE, 0.8, -1.0, 1.0),
    Parameter(THR_TILE, NOT_IN_USE, 0.0, 1.0, special=NOT_IN_USE),
    Parameter(THR_TRAV, 0.4, 0.0, 1.0),
    Parameter(POLICY, float(Policy.REPORT), 0.0, float(max(Policy)), whole=True),
)


_SUMMARY_HZ, _NUMBER_HZ = (1.0 / (MESSAGES[name].period or 1.0) for name in ("summary", "number"))
_MORE = (
    Parameter(ROI["left"], 0.333, 0.0, 1.0),
    Parameter(ROI["top"], 0.6, 0.0, 1.0),
    Parameter(ROI["right"], 0.667, 0.0, 1.0),
    Parameter(ROI["bottom"], 0.95, 0.0, 1.0),
    Parameter(SUMMARY_RATE, _SUMMARY_HZ, 0.0, 5.0),
    Parameter(NUMBER_RATE, _NUMBER_HZ, 0.0, 2.0),
    Parameter(BUDGET, 300.0, 50.0, 1e6, special=0.0),
    Parameter(ANSWER, 0.0, 0.0, 10.0 * 0xFFFF + OTHER_PLACE, whole=True),
    Parameter(TAP_WORD, -1.0, -1.0, float(MAX_PARAMETERS - 1), whole=True),
)
"""Settings that were added later. They come last, so that the words keep their indices."""

MANY = 1e6
"""The greatest value of a counter; it stays there."""
_COUNTS = (
    Parameter(SHADOW_HOLDS, 0.0, 0.0, MANY, whole=True),
    Parameter(SHADOW_HOURS, 0.0, 0.0, MANY, read_only=True),
    *(Parameter(name, 0.0, 0.0, MANY, whole=True, read_only=True) for name in SHADOW_REASONS.values()),
)


def word_parameter(word: str, alias: str | None = None) -> str:
    """Name the parameter of a word's weight: "dry grass" -> "AT_W_DRY_GRASS". Raises ParameterError."""
    if alias is not None:
        plain = alias
    else:
        ascii_only = unicodedata.normalize("NFKD", word).encode("ascii", "ignore").decode()
        plain = re.sub(r"[^A-Z0-9]+", "_", ascii_only.upper()).strip("_")[:_ROOM].rstrip("_")
    name = WORD_PREFIX + plain
    if not _ALIAS.fullmatch(plain) or len(name) > MAX_NAME:
        raise ParameterError(f'word "{word}" needs an alias of 1 to {_ROOM} characters from A-Z, 0-9 and _')
    return name


def build(
    vocabulary: Sequence[str],
    weights: Mapping[str, float],
    settings: Mapping[str, float],
    *,
    aliases: Mapping[str, str] = _NO_ALIASES,
) -> tuple[Parameter, ...]:
    """Build the list of parameters, whose order is fixed.

    First thresholds and policy, then the weight of every word of the configured vocabulary, the counts of
    shadow policy, and the other settings. weights: of the words in use; the others get -2. settings:
    parameter name (AT_THR_ROI, ...) -> value; the others keep their defaults. aliases: word -> name after
    AT_W_, where the word's own does not fit. Raises ParameterError for unknown names, values out of range,
    more than 24 words, and names that collide.
    """
    if len(vocabulary) > MAX_WORDS:
        raise ParameterError(f"{len(vocabulary)} words are configured, at most {MAX_WORDS} fit: remove some")
    for name in settings.keys() - {setting.name for setting in (*_SETTINGS, *_MORE)}:
        raise ParameterError(f"there is no setting {name}")
    for word in (weights.keys() | aliases.keys()) - set(vocabulary):
        raise ParameterError(f'word "{word}" is not in the configured vocabulary: add it there')
    first, last = (
        [_with_value(setting, settings.get(setting.name, setting.value)) for setting in group]
        for group in (_SETTINGS, _MORE)
    )
    words: list[Parameter] = []
    owners: dict[str, str] = {}
    for word in vocabulary:
        name = word_parameter(word, aliases.get(word))
        if name in owners:
            raise ParameterError(f'words "{owners[name]}" and "{word}" are both {name}: give one an alias')
        owners[name] = word
        weight = Parameter(name, NOT_IN_USE, -1.0, 1.0, special=NOT_IN_USE, word=word)
        words.append(_with_value(weight, weights.get(word, NOT_IN_USE)))
    return (*first, *words, *_COUNTS, *last)


def _with_value(parameter: Parameter, value: float) -> Parameter:
    if not parameter.accepts(value):
        raise ParameterError(f"{parameter.name} = {value:g} is refused: it takes {parameter.allowed()}")
    return replace(parameter, value=value)


@dataclass(frozen=True)
class ListOptions:
    """A client's options: `count` parameters (0: all) from index `start` on.

    with_defaults: whether to add the configured values.
    """

    start: int = 0
    count: int = 0
    with_defaults: bool = False

    @classmethod
    def read(cls, query: str) -> ListOptions:
        """Parse `start=5&count=10&withdefaults=1`, any of them; others are ignored. Raises ValueError."""
        options = dict(parse_qsl(query, keep_blank_values=True))
        start, count = (_number(options.get(name, "0"), _LAST) for name in ("start", "count"))
        return cls(start, count, bool(_number(options.get("withdefaults", "0"), 1)))


def pack(parameters: Sequence[Parameter], options: ListOptions, configured: Mapping[str, float]) -> bytes:
    """Pack the file. configured: name -> configured value, packed where it differs from the value in force.

    Raises ValueError when there are no parameters from `options.start` on.
    """
    chosen = parameters[options.start :][: options.count or None]
    if options.start and not chosen:
        raise ValueError(f"there are {len(parameters)} parameters, none from {options.start} on")
    magic = MAGIC_WITH_DEFAULTS if options.with_defaults else MAGIC
    packed, before = _HEAD.pack(magic, len(chosen), len(parameters)), ""
    for one in chosen:
        default = configured.get(one.name) if options.with_defaults else None
        packed += _row(one, before, default)
        before = one.name
    return packed


def _row(parameter: Parameter, before: str, default: float | None) -> bytes:
    name, values = parameter.name, struct.pack("<f", parameter.value)
    common = min(_in_common(before, name), len(name) - 1, _MOST_IN_COMMON)
    rest = name[common:].encode()
    kind = _FLOAT
    if default is not None and round(default, _DIGITS) != round(parameter.value, _DIGITS):
        kind |= _HAS_DEFAULT
        values += struct.pack("<f", default)
    return bytes([kind, (len(rest) - 1) << 4 | common]) + rest + values


def _in_common(one: str, other: str) -> int:
    same = [a == b for a, b in zip(one, other, strict=False)]
    return same.index(False) if False in same else len(same)


def _number(text: str, most: int) -> int:
    if not text.isascii() or not text.isdigit() or int(text) > most:
        raise ValueError(f'"{text}" is not a number up to {most}')
    return int(text)
