"""Says which settings a page may change, and which only the shell may, or a page over loopback."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from enum import Enum

from companion.cameras import SourceError, split_source
from companion.config.checks import ValueCheck, checks_of
from companion.config.link_settings import LinkSettingError, read_url
from companion.config.radio import ConnectionSection
from companion.config.schema import OF_A_VEHICLE, SECTIONS, WORD_KEYS
from companion.config.toml_file import nearest


class Guard(Enum):
    """Who may change a setting.

    OPEN: whoever may use a page. LOOPBACK: only who is on this computer: in the shell, or on a page over
    loopback. Whoever has a page's token must not be able to run a program, to read a file, to let somebody
    else in, to have the vehicle commanded, to delete recordings or to keep the companion from starting.
    """

    OPEN = "open"
    LOOPBACK = "loopback"


_COMMANDS = frozenset(
    {
        "call.policy",
        "call.fault_ends_hold",
        "call.off_channel",
        "call.off_side",
        "call.px4_hold",
        "call.px4_deadman",
        "guide.corridor",
        "guide.radius",
    }
)
"""What decides whether and how the vehicle is commanded, and who may stop that."""
_WHOLE = frozenset({"stopping", "mount", "perceiver"})
"""Sections that decide whether the vehicle stops in time, or with which a perceiver may not start."""
_WHO_MAY = frozenset({"link.allowed_senders", "link.unsigned_autopilot", "link.system_id"})
_DELETES = frozenset({"recording.size"})
_DEVICE = re.compile(r"/dev/(?!.*\.\.)(video|v4l/|tty|serial|anytraverse-)[\w.:/@+-]*", re.ASCII)
"""Of cameras and serial ports."""


def _harmless_source(source: str) -> bool:
    """Whether a camera is a device or a host: a program is run, and files of this computer are shown."""
    kind, place = split_source(source)
    return kind in {"rtsp", "http", "https", "oak", "field"} or (
        kind == "v4l2" and (place.isdecimal() or _DEVICE.fullmatch(place) is not None)
    )


def _harmless_url(url: str) -> bool:
    """Whether only this computer is on the link: a serial port, or a port of loopback."""
    address = read_url(url)
    if address.scheme == "serial":
        return _DEVICE.fullmatch(address.place) is not None
    return address.place.startswith("127.")


_OPEN_VALUES: Mapping[str, Callable[[str], bool]] = {
    "camera.source": _harmless_source,
    "link.url": _harmless_url,
    "call.policy": lambda policy: policy in {"report", "shadow"},
}
"""Settings of which some values are open."""


def split_key(key: str) -> tuple[str, ...]:
    """Split "call.votes", "words.dry grass", "words" or "link.more.wifi.url" into keys of the file.

    "words", "aliases", "vocabulary" and "link.more" are keys of the whole.
    Raises ValueError for a setting that does not exist.
    """
    name, _, rest = key.partition(".")
    if name in WORD_KEYS:
        if key != name and (not rest or name == "vocabulary"):
            raise ValueError("give the whole list" if rest else "name the word")
        return (name, rest) if rest else (name,)
    if name not in SECTIONS:
        raise ValueError(f"is not known; {nearest(name, (*WORD_KEYS, *SECTIONS))}")
    keys: tuple[str, ...] = (name, rest)
    known = checks_of(SECTIONS[name])
    if (name, rest.partition(".")[0]) == ("link", "more") and rest != "more":
        keys = (name, *rest.split("."))
        if len(keys) != 4:
            raise ValueError("is not known; write link.more.NAME.url")
        known = checks_of(ConnectionSection)
    if keys[-1] not in known:
        raise ValueError(f"is not known; {nearest(keys[-1], known)}")
    return keys


def guard_of(key: str, value: object) -> Guard:
    """Return who may set `key` ("section.key", "words.WORD") to `value`, None: remove it.

    A text is guarded unless it is known to be harmless: a setting to come may name a file or a program.
    Raises ValueError for a setting that does not exist.
    """
    keys = split_key(key)
    if keys[0] in WORD_KEYS:
        return Guard.OPEN
    if keys[:2] == ("link", "more"):
        return Guard.LOOPBACK
    if key in _OPEN_VALUES:
        return Guard.OPEN if _is_open(key, value) else Guard.LOOPBACK
    check: ValueCheck = checks_of(SECTIONS[keys[0]])[keys[1]]
    free_text = check.schema.get("type") == "string"
    guarded = keys[0] in _WHOLE or key in _COMMANDS | _WHO_MAY | _DELETES
    return Guard.LOOPBACK if free_text or guarded else Guard.OPEN


def guards_words(perceiver: object) -> bool:
    """Whether words are guarded with a perceiver ("kind:argument"), None: the default.

    Which words a bundle knows is not checked before it is loaded: with a wrong one no start would succeed.
    """
    return perceiver is not None and str(perceiver).partition(":")[0] != "builtin"


def guards_old(key: str, value: object) -> bool:
    """Whether a change of `key` is guarded since `value` is in force: a program, or a policy that holds.

    Of other settings only the new value counts: whoever sets a camera may do so on a rover without one.
    """
    if key == "camera.source":
        return isinstance(value, str) and value.startswith("pipe:")
    return key == "call.policy" and not _is_open(key, value)


def only_in_shell(key: str, value: object) -> bool:
    """Whether a page may set `key` to nothing at all while `value` is in force. Raises as `guard_of`."""
    some_are_open = key in _OPEN_VALUES and not guards_old(key, value)
    return not some_are_open and (guards_old(key, value) or guard_of(key, None) is Guard.LOOPBACK)


def _is_open(key: str, value: object) -> bool:
    section, _, name = key.partition(".")
    if value is None:
        if section in OF_A_VEHICLE:  # the value of the vehicle's file would come into force
            return False
        value = getattr(SECTIONS[section](), name)
    try:
        return isinstance(value, str) and _OPEN_VALUES[key](value)
    except (SourceError, LinkSettingError):
        return False
