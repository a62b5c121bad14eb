"""Looks for passwords of cameras in all that a companion prints, logs, records and packs."""

from __future__ import annotations

import contextlib
import io
import json
import signal
import subprocess
import sys
import time
import zipfile
from collections.abc import Iterator
from pathlib import Path

from mcap.reader import make_reader

from bench.attack.outcome import AttackOutcome
from companion.sim.demo.rehearsal import free_port

PASSWORD, TOKEN = "hunter2-Xyzzy", "sesame-open-sesame"
_HOST = "127.0.0.1:{port}"
FORMS = (
    f"rtsp://admin:{PASSWORD}@{_HOST}/live",
    f"rtsp://admin:{PASSWORD}/x@{_HOST}/live",
    f"RTSP://admin:{PASSWORD}@{_HOST}/live",
    f"rtsp://{_HOST}/user=admin&password={PASSWORD}&channel=1",
    f"rtsp://{_HOST}/admin/{PASSWORD}/stream",
    f"http://{_HOST}/video?key={PASSWORD}",
    f"http://{_HOST}/video?auth={PASSWORD}",
    f"http://{_HOST}/video?usr=admin&psw={PASSWORD}",
    f"http://{_HOST}/video?loginuse=admin&loginpas={PASSWORD}",
    f"http://{_HOST}/video?api_key={PASSWORD}",
    f"http://{_HOST}/{PASSWORD}",
    f"pipe:gst-launch-1.0 rtspsrc location=rtsp://{_HOST} user-id=admin user-pw={PASSWORD} ! fdsink",
    f"pipe:gst-launch-1.0 rtspsrc location=rtsp://admin:{PASSWORD}@{_HOST}/a ! fdsink",
    f"pipe:ffmpeg -i rtsp://admin:{PASSWORD}@{_HOST}/a -f rawvideo -",
    f"pipe:ffmpeg -headers 'Authorization: Basic {PASSWORD}' -i http://{_HOST}/a -f rawvideo -",
    f"pipe:ffmpeg -cookies 'session={PASSWORD}' -i http://{_HOST}/a -f rawvideo -",
    f"pipe:curl -u admin:{PASSWORD} http://{_HOST}/a",
    f"pipe:curl -uadmin:{PASSWORD} http://{_HOST}/a",
    f"pipe:curl --user=admin:{PASSWORD} http://{_HOST}/a",
    f"pipe:curl -H 'Authorization: Bearer {PASSWORD}' http://{_HOST}/a",
    f"pipe:curl -H 'X-Api-Key: {PASSWORD}' http://{_HOST}/a",
    f"pipe:sh -c 'echo {PASSWORD} >&2; false'",
    f"pipe:env CAMERA_PASSWORD={PASSWORD} false",
    f"pipe:false --password {PASSWORD}",
    f"pipe:false {PASSWORD}",
)
QUICK = 3
_SEES_WITHIN = 8.0
_CONFIG = """\
[camera]
source = {source}
width = 16
height = 16
pixel_format = "gray"
[perceiver]
name = "builtin:lexicon"
[web]
listen = ""
token = "{token}"
[vehicle]
file = ""
[recording]
size = 20
[link]
url = "udpout:127.0.0.1:{radio}"
[journal]
folder = "state"
"""


def secrets(folder: Path, *, quick: bool) -> AttackOutcome:
    """Check, run and pack a companion with each of `FORMS`, and look through all that is left of it."""
    outcome = AttackOutcome()
    for number, form in enumerate(FORMS[:: len(FORMS) // QUICK] if quick else FORMS):
        place = folder / str(number)
        place.mkdir()
        config = place / "companion.toml"
        source = json.dumps(form.format(port=free_port()))
        config.touch(0o600)
        config.write_text(_CONFIG.format(source=source, token=TOKEN, radio=free_port()), encoding="utf-8")
        said = _typed("config", "check", str(config)) + _run(place, config)
        said += _typed("incident", "--last", "60s", "--config", str(config), "--out", str(place / "it.zip"))
        said += _typed("status", str(config), "--json")
        config.unlink()
        for name, content in (("the terminal", said), *_contents(place)):
            outcome.secrets += [f"{name}: {form}" for one in (PASSWORD, TOKEN) if one.encode() in content]
        outcome.figures[form.partition(":")[0]] = outcome.figures.get(form.partition(":")[0], 0) + 1
    return outcome


def _typed(*words: str) -> bytes:
    done = subprocess.run(
        [sys.executable, "-m", "companion", *words], capture_output=True, check=False, timeout=60.0
    )
    return done.stdout + done.stderr


def _run(place: Path, config: Path) -> bytes:
    """Run the companion until it has said why it sees nothing."""
    command = [sys.executable, "-m", "companion", "run", str(config)]
    with (place / "stderr").open("wb") as errors, subprocess.Popen(command, stderr=errors) as daemon:
        status, until = place / "state" / "status.json", time.monotonic() + _SEES_WITHIN
        while time.monotonic() < until and not (status.is_file() and "fault" in status.read_text()):
            time.sleep(0.2)
        time.sleep(1.0)
        daemon.send_signal(signal.SIGTERM)
        with contextlib.suppress(subprocess.TimeoutExpired):
            daemon.wait(10.0)
        daemon.kill()
    return (place / "stderr").read_bytes()


def _contents(folder: Path) -> Iterator[tuple[str, bytes]]:
    """Yield all files, unpacked."""
    for path in folder.rglob("*"):
        if path.is_file():
            yield from _unpacked(path.name, path.read_bytes())


def _unpacked(name: str, content: bytes) -> Iterator[tuple[str, bytes]]:
    yield name, content
    if name.endswith(".zip"):
        with zipfile.ZipFile(io.BytesIO(content)) as packed:
            for member in packed.namelist():
                yield from _unpacked(member, packed.read(member))
    if name.endswith(".mcap"):
        for _, _, message in make_reader(io.BytesIO(content)).iter_messages():
            yield name, message.data
