"""Says what of the network a camera needs, and has systemd limit the vision process to it.

Root runs `python -m companion.vision.network_limit FILE` before the companion starts, FILE: the settings.
"""

from __future__ import annotations

import ipaddress
import re
import subprocess
import sys
from pathlib import Path
from typing import NamedTuple
from urllib.parse import urlsplit

from companion.cameras import CameraError, split_source
from companion.cameras.places import pipe_words
from companion.cameras.shown import CAMERA_ELEMENTS, address, program

_SLICE = "companion-camera.slice"
_TOLD = Path("/run/systemd/system.control", f"{_SLICE}.d")
_WITHIN = 10.0
OF_PATHS = frozenset({"video", "folder", "v4l2"})
"""Kinds of camera whose place is a path here. Others may hold a password, which must not be shown."""
_CAMERA_PROGRAMS = frozenset({"rpicam-vid", "rpicam-raw", "libcamera-vid", "libcamera-raw"})
_END = re.compile(r"(src|sink)\d*\Z", re.ASCII)
"""How the name of a GStreamer element that reads or sends ends: v4l2src, udpsink, rtmp2sink."""
_OWN_SINKS = frozenset({"fdsink", "filesink"})


class NetworkNeeds(NamedTuple):
    """What of the network a camera needs.

    any: whether it needs any; an OAK on USB needs the kernel's messages about devices. networks: which it
    reaches, each as "10.0.0.7/32"; None: they are not known.
    """

    any: bool
    networks: tuple[str, ...] | None = ()


def needs_of(source: str) -> NetworkNeeds:
    """Return what a camera needs. source: `[camera] source`. Raises CameraError for one that is none."""
    kind, place = split_source(source)
    if kind in OF_PATHS:
        return NetworkNeeds(any=False)
    if kind == "pipe":
        own = _is_of_this_computer(place)
        return NetworkNeeds(any=not own, networks=() if own else None)
    if kind == "field":
        return NetworkNeeds(any=True, networks=_networks("localhost"))
    if kind == "oak":  # on USB; one that is named may be on a network, where it is looked for by broadcast
        return NetworkNeeds(any=True, networks=None if place else ())
    return NetworkNeeds(any=True, networks=_networks(urlsplit(address(source)).hostname or "") or None)


def _is_of_this_computer(command: str) -> bool:
    """Whether a program reads a camera of this computer, and sends to no network, as far as it is known."""
    if "://" in command:
        return False
    if program(command) in _CAMERA_PROGRAMS:
        return True
    words = pipe_words(command)
    ends = [word for word in words if _END.search(word) and word not in _OWN_SINKS]
    return len(ends) == 1 and ends[0] in CAMERA_ELEMENTS


def _networks(host: str) -> tuple[str, ...]:
    """Return the networks of a numeric address, none for a name."""
    if host == "localhost":
        return ("127.0.0.0/8", "::1/128")
    try:
        return () if "%" in host else (str(ipaddress.ip_network(host)),)
    except ValueError:
        return ()


def is_limited(needs: NetworkNeeds) -> bool:
    """Whether systemd was told these networks when the companion started, and no other."""
    if needs.networks is None:
        return False
    denied, allowed = (_told(name) for name in ("IPAddressDeny", "IPAddressAllow"))
    return "0.0.0.0/0" in denied and allowed == {*needs.networks}


def _told(name: str) -> set[str]:
    try:
        lines = (_TOLD / f"50-{name}.conf").read_text().splitlines()
    except OSError:
        return set()
    return {line.partition("=")[2] for line in lines if line.startswith(f"{name}=")} - {""}


def main(file: str) -> int:
    """Limit it. Returns the exit code."""
    from companion.config import ConfigError, load_config

    try:
        networks = needs_of(load_config(file).camera.source).networks
    except (ConfigError, CameraError):  # the companion says what is wrong with them
        return 1
    # An empty value takes back what was told before.
    told = ["IPAddressDeny=", "IPAddressAllow="]
    if networks is not None:
        told += ["IPAddressDeny=any", *(f"IPAddressAllow={network}" for network in networks)]
    asked = ["systemctl", "set-property", "--runtime", _SLICE, *told]
    return subprocess.run(asked, check=False, timeout=_WITHIN).returncode


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
