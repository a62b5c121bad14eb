"""Makes what may be shown or stored of a source, an address or a path: the one place that decides it.

A source may hold a password anywhere: before the host, in the path, in the query, in a program's arguments.
So only what is known to be harmless is taken from it, and "..." stands for the rest.
"""

from __future__ import annotations

import ipaddress
import os
import re
import shlex
from collections.abc import Collection
from urllib.parse import unquote

__all__ = ["CAMERA_ELEMENTS", "LEFT_OUT", "address", "is_like_a_url", "plain_words", "program", "shown"]

LEFT_OUT = "..."

_OF_PATHS = frozenset({"video", "folder", "v4l2", "serial"})
_OF_HOSTS = frozenset(
    {"rtsp", "rtsps", "rtmp", "rtmps", "http", "https", "ftp", "mms", "rtp", "srt", "udp", "ws", "wss"}
    | {"field", "oak", "tcp", "udpin", "udpout"}
)
_GSTREAMER = frozenset({"gst-launch", "gst-launch-1.0"})
CAMERA_ELEMENTS = frozenset(
    {"libcamerasrc", "nvarguscamerasrc", "nvv4l2camerasrc", "rpicamsrc", "v4l2src", "uvch264src"}
)
"""Source elements of GStreamer that read a camera of this computer."""
_ELEMENTS = frozenset(
    CAMERA_ELEMENTS
    | {"rtspsrc", "rtmpsrc", "rtmp2src", "souphttpsrc", "srtsrc", "tcpclientsrc", "udpsrc", "ndisrc"}
    | {"uridecodebin", "urisourcebin", "playbin", "filesrc", "multifilesrc", "videotestsrc", "zedsrc"}
)
"""Source elements of GStreamer whose names are shown."""

_URL = re.compile(r"(?P<kind>[^:]*):(?P<slashes>/*)(?P<authority>[^/?#\\]*)(?P<rest>.*)", re.DOTALL)
_HOST = re.compile(r"(?P<host>[\w.-]+|\[[0-9A-Fa-f:.]+(?:%\w+)?\])(?::[0-9]{1,5})?", re.ASCII)
_LIKE_A_URL = re.compile(r":/|:.*@|[?&][^/]*=", re.DOTALL)
_PATHS = ("/", "./", "../", "~")
_NAME = re.compile(r"[\w ./+-]*(?::[0-9]+)?")
"""What a path looks like that does not begin as one; a serial port's has a baud rate."""
_PROGRAM = re.compile(r"[\w.+/-]+")
_LONGEST_WORD, _LONGEST_NUMBER, _LEAST_SECRET = 20, 3, 4
_MARKS = "\"'`()[]{}<>,.:;!?*%|-"


def shown(text: str, kinds: Collection[str] = _OF_PATHS) -> str:
    """Return what may be shown of a source, an address or a path.

    Of a URL scheme, host and port; of a command the program's name, and GStreamer's source element; a path as
    it is, unless it looks like a URL. kinds: what may stand before the ":" of a path.
    """
    kind, colon, place = text.partition(":")
    if not colon or text.startswith(_PATHS):
        return _path(text)
    if kind == "pipe":
        return f"pipe:{_command(place)}"
    if kind in kinds:
        return f"{kind}:{_path(place)}"
    if kind.lower() in _OF_HOSTS:
        found = address(text) if place else text
        whole = text.removesuffix("/") == found
        return (found if whole else f"{found}/{LEFT_OUT}") if found else f"{kind.lower()}:{LEFT_OUT}"
    host, _, port = text.rpartition(":")
    return text if _is_numeric(host) and port.isdecimal() else LEFT_OUT


def address(url: str) -> str:
    """Return scheme, host and port of a URL; "" where they cannot be told from a user and a password.

    They cannot where an "@" follows the host, since a password with a "/", "?" or "#" in it looks like that.
    """
    split = _URL.fullmatch(url)
    if split is None:
        return ""
    place = split["authority"].rpartition("@")[2]
    host = _HOST.fullmatch(place)
    if host is None or ("@" in split["rest"] and not _is_numeric(host["host"])):
        return ""
    return f"{split['kind'].lower()}:{split['slashes'][:2]}{place}"


def program(command: str) -> str:
    """Return the name of a command's program; "" where the first word is not a program's name or path."""
    first = next(iter(_words(command)), "")
    return os.path.basename(first) if _PROGRAM.fullmatch(first) else ""


def is_like_a_url(path: str) -> bool:
    """Whether a URL seems to stand where a path is expected."""
    return _LIKE_A_URL.search(path) is not None


def plain_words(text: str, source: str = "") -> str:
    """Return the plain words and short numbers of what a program or a driver says of `source`, "" for none.

    It may repeat the source or parts of it, decoded, encoded or cut off. So a word of four letters or more
    that occurs in the source is left out, too.
    """
    known = f"{source} {unquote(source)}".casefold()
    kept: list[str] = []
    for word in text.split():
        one = word if _is_plain(word, known) else LEFT_OUT
        if one != LEFT_OUT or kept[-1:] != [LEFT_OUT]:
            kept.append(one)
    return "" if kept == [LEFT_OUT] else " ".join(kept)


def _is_plain(word: str, known: str) -> bool:
    core = word.strip(_MARKS)
    if not core or core.isdecimal():
        return len(core or word) <= _LONGEST_NUMBER
    letters = core.replace("-", "").replace("'", "")
    even = core.islower() or core.isupper() or core.istitle()  # else it may be base64
    if not (letters.isalpha() and even and len(core) <= _LONGEST_WORD):
        return False
    return len(core) < _LEAST_SECRET or core.casefold() not in known


def _path(path: str) -> str:
    harmless = not is_like_a_url(path) if path.startswith(_PATHS) else _NAME.fullmatch(path)
    return path if harmless else LEFT_OUT


def _command(command: str) -> str:
    words = _words(command)
    name = program(command)
    if name in _GSTREAMER:
        name = " ".join([name, *[word for word in words[1:] if word in _ELEMENTS][:1]])
    return name if name == command else f"{name} {LEFT_OUT}".lstrip()


def _words(command: str) -> list[str]:
    try:
        return shlex.split(command)
    except ValueError:  # its quotes are wrong
        return command.split()


def _is_numeric(host: str) -> bool:
    try:
        return host == "localhost" or ipaddress.ip_address(host.strip("[]")) is not None
    except ValueError:
        return False
