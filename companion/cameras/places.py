"""Checks the place that a source names, by its kind, without opening anything: no camera, no OpenCV."""

from __future__ import annotations

import ipaddress
import os
import shlex
import shutil
from collections.abc import Callable, Collection, Mapping
from difflib import get_close_matches
from importlib.util import find_spec
from urllib.parse import SplitResult, urlsplit

from anytraverse.release import to_install
from companion.cameras.shown import address, is_like_a_url, program, shown

OF_FILES = ("video", "folder", "v4l2")
_FILMS = (".mp4", ".mkv", ".avi", ".mov", ".webm")


class CameraError(Exception):
    """The camera is absent or lost, and must be opened again. The text says what to check."""


class SourceError(CameraError, ValueError):
    """The source names no camera, or the software that this kind needs is not installed."""


def check_place(kind: str, place: str) -> None:
    """Accept the place of a camera of this kind. Raises SourceError where none can be there."""
    if not place.strip() and kind != "oak":
        raise SourceError(f'"{kind}:" says what kind of camera but not where: write {kind}:PLACE')
    if kind in OF_FILES and is_like_a_url(place):
        raise SourceError(
            f"{kind}: is for files and devices of this computer: begin an address with rtsp:// or http://"
        )
    if kind in _CHECKS:
        _CHECKS[kind](place)


def field_address(place: str) -> tuple[str, int]:
    """Return host and port of the simulated field's camera. Raises SourceError."""
    host, _, number = place.rpartition(":")
    try:
        port = int(number)
        loopback = host == "localhost" or ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        raise SourceError("the field's camera is at no such address: write field:127.0.0.1:PORT") from None
    if not loopback or not 0 < port < 65536:
        raise SourceError(
            f"{shown(f'field:{place}')} is no loopback address with a port: write field:127.0.0.1:PORT"
        )
    return host.strip("[]"), port


def network_url(url: str) -> SplitResult:
    """Split a URL. Raises SourceError when it names no host, or when its host may be part of a password."""
    try:
        split = urlsplit(url)
        if split.hostname and split.port != 0 and url.isascii() and " " not in url and address(url):
            return split
    except ValueError:  # a wrong port
        pass
    scheme = url.partition(":")[0]
    raise SourceError(
        f"the source is no address: write {scheme}://USER:PASSWORD@HOST:PORT/PATH, "
        "with %40 for an @ elsewhere, and %2F, %3F and %23 for / ? # in a password"
    )


def pipe_words(command: str) -> list[str]:
    """Split a program's command like a shell does. Raises SourceError."""
    try:
        words = shlex.split(command)
    except ValueError as error:
        raise SourceError(
            f"the command of [camera] source cannot be read ({error}): check its quotes"
        ) from error
    if not words:
        raise SourceError("the source pipe: names no command: write pipe:COMMAND")
    return words


_CHECKS: Mapping[str, Callable[[str], object]] = {
    "field": field_address,
    "pipe": pipe_words,
    "rtsp": lambda place: network_url(f"rtsp:{place}"),
    "http": lambda place: network_url(f"http:{place}"),
    "https": lambda place: network_url(f"https:{place}"),
}


def meant(source: str, kinds: Collection[str]) -> str:
    """Return the source that was probably meant by one that names no camera, as it may be shown; else ""."""
    if source.startswith(("/dev/video", "/dev/v4l/")):
        return shown(f"v4l2:{source}")
    if source.isdecimal():
        return f"v4l2:/dev/video{source}"
    if source.lower().endswith(_FILMS) and ":" not in source:
        return shown(f"video:{source}")
    kind, colon, place = source.partition(":")
    near = get_close_matches(kind.lower(), kinds, 1) if colon else []
    return shown(f"{near[0]}:{place}") if near else ""


def absent_now(kind: str, place: str) -> str:
    """Say what of a source is not there now, and what to do; "" where nothing is known to be missing.

    A relative path counts from the folder in which this runs.
    """
    if kind in OF_FILES:
        path = os.path.expanduser(f"/dev/video{place}" if kind == "v4l2" and place.isdecimal() else place)
        where = "" if os.path.isabs(path) else f" in {os.getcwd()}"
        absent = f"there is no {shown(path)}{where} now: `companion cameras` lists the cameras that are there"
        return "" if os.path.exists(path) else absent
    if kind == "pipe" and shutil.which(pipe_words(place)[0]) is None:
        return f"{program(place) or 'the program'} is not installed, or not executable, here"
    if kind == "oak" and find_spec("depthai") is None:
        return f"depthai is not installed here: {to_install('oak')}"
    return ""
