"""A folder of painted frames, and the configuration of a companion that drives by them."""

from __future__ import annotations

from pathlib import Path

import cv2

from tests.companion.daemon.rig import picture

CONFIG = """
[camera]
source = "folder:{frames}"
loop = true
[perceiver]
name = "painted"
[web]
listen = "{listen}"
token = "{token}"
[recording]
size = {recorded}
rate = 5
[vehicle]
file = ""
[link]
url = "udpout:127.0.0.1:{port}"
{link}
[journal]
folder = "{state}"
[words]
grass = 1.0
"""


def to_a_drum(
    folder: Path, port: int, link: str = "", listen: str = "", token: str = "", recorded: int = 0
) -> Path:
    """Writes a frame of grass and 29 of a drum without a word; returns the configuration.

    port: of the ground on 127.0.0.1. link: more lines of [link]. listen, token: of [web]. recorded: MB.
    """
    frames = folder / "frames"
    frames.mkdir()
    for number in range(30):
        cv2.imwrite(str(frames / f"{number}.png"), picture("drum" if number else "")[..., ::-1])
    config = folder / "companion.toml"
    values = {"frames": frames, "port": port, "link": link, "state": folder / "state"}
    config.write_text(CONFIG.format(**values, listen=listen, token=token, recorded=recorded))
    config.chmod(0o600)  # it may hold a token
    return config
