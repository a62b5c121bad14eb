"""No part of a camera's password leaves companion.toml: not by text, log, status, recording or incident."""

from __future__ import annotations

import json
import logging
import socket
import time
import zipfile
from collections import deque
from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from pathlib import Path

import pytest

pytest.importorskip("mcap")

from mcap.reader import make_reader

from bench.virtual_time import virtual_time
from companion import run
from companion.cameras import open_camera
from companion.cameras.newest import CameraState, CameraStatus, CameraThread, Patience
from companion.cli import main
from companion.config import Config, load_config
from companion.desk.check import cameras
from companion.observers.recording.ring import FOLDER
from companion.observers.recording.ring_writer import RingWriter
from companion.observers.recording.topics import Topic
from companion.storage.log_file import NAME as LOG
from companion.wire.ids import Policy
from tests.companion.cameras.sources import ADDRESS, FORMS, PIPES, SECRETS, Form
from tests.companion.daemon.rig import Rig
from tests.companion.vision import painted
from tests.waiting import wait_for

PROGRAM = """#!/bin/sh
echo "error 401 Unauthorized: cannot open $* with $PASSWORD" >&2
for one; do
    echo "argument <$one>" >&2
    printf %s "$one" | base64 >&2
done
exit 3
"""
TOKEN = "sesame-open-sesame"


@pytest.fixture
def closed() -> Iterator[str]:
    """An address at which nothing listens."""
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        yield f"127.0.0.1:{taken.getsockname()[1]}"


@pytest.fixture(autouse=True)
def _programs(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Programs that repeat all that they were given, and no camera that is plugged in."""
    (tmp_path / "bin").mkdir()
    for name in ("gst-launch-1.0", "ffmpeg", "curl", "cam"):
        (tmp_path / "bin" / name).write_text(PROGRAM)
        (tmp_path / "bin" / name).chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path / "bin"), prepend=":")
    monkeypatch.setattr("companion.cameras.pipe._KNOWN_LINES", deque[str](maxlen=200))
    for name in ("devices", "_of_rpicam", "_of_depthai"):
        monkeypatch.setattr(cameras, name, lambda: iter(()))


def written(folder: Path, source: str, more: str = "") -> Path:
    path = folder / "companion.toml"
    path.write_text(
        f"""
        [camera]
        source = {json.dumps(source)}
        width = 16
        height = 16
        pixel_format = "gray"
        {more}
        [web]
        listen = ""
        token = "{TOKEN}"
        [vehicle]
        file = ""
        [journal]
        folder = "{folder / "state"}"
        """
    )
    path.chmod(0o600)
    return path


def typed(capsys: pytest.CaptureFixture[str], *words: str) -> tuple[int, str]:
    code = main([*words])
    return code, "".join(capsys.readouterr())


def failed(source: str, config: Config) -> CameraStatus:
    """What becomes of the camera, as the vision process opens it."""
    patience = Patience(first=60.0, silence=0.5)
    thread = CameraThread(partial(open_camera, source, config.camera_options), patience=patience)
    try:
        wait_for(lambda: thread.state is CameraState.FAILED)
        return thread.status
    finally:
        assert thread.close()


def driven(config: Config, status: CameraStatus, monkeypatch: pytest.MonkeyPatch) -> str:
    """A daemon with this configuration and camera drives, and records. Returns what /state.json says."""
    state = config.journal.path
    state.mkdir(exist_ok=True)
    with virtual_time() as clock, monkeypatch.context() as patched:
        patched.setattr(Rig, "config", replace(config, stopping=Rig.config.stopping))
        rig = Rig(state, clock, Policy.REPORT)
        try:
            rig.daemon.recording.listeners = (1,)
            with rig.daemon.recording.log_lines():
                logging.getLogger("camera").warning("no camera: %s; trying again", status.reason)
                rig.see(0.5)
                rig.camera.status = status
                rig.wait(2.5)
                rig.daemon.write_status(web={})
                rig.wait(0.1)
            messages = rig.daemon.recording.take()
            said = json.dumps(rig.daemon.status.state_file()) + " ".join(rig.texts)
        finally:
            rig.kill()
    assert {Topic.SETUP, Topic.STATUS, Topic.LOG} <= {one.topic for one in messages}
    ring = RingWriter(state / FOLDER, 20_000_000)
    ring.begin(0.0)
    for one in messages:
        ring.write(one, 0.0)
    ring.finish(1.0)
    return said


def contents(folder: Path) -> Iterator[tuple[str, bytes]]:
    """Each file below a folder but the configuration, unpacked."""
    for path in folder.rglob("*"):
        if not path.is_file() or path.name == "companion.toml" or path.parent.name == "bin":
            continue
        yield path.name, path.read_bytes()
        if path.suffix == ".mcap":
            yield from ((path.name, one.data) for _, _, one in make_reader(path.open("rb")).iter_messages())
        if path.suffix == ".zip":
            with zipfile.ZipFile(path) as packed:
                packed.extractall(folder / "unpacked" / path.stem)
            yield from contents(folder / "unpacked" / path.stem)


def leaks(said: str) -> list[str]:
    return [secret for secret in (*SECRETS, TOKEN) if secret.casefold() in said.casefold()]


def test_the_table_has_more_than_fifty_forms() -> None:
    assert len(FORMS) > 50
    for name, form in FORMS.items():
        assert any(secret in form.source for secret in SECRETS) or "%63" in form.source, name


@pytest.mark.parametrize("form", FORMS.values(), ids=FORMS)
def test_no_secret_is_shown_or_stored_and_the_camera_can_be_told(
    form: Form,
    closed: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    caplog: pytest.LogCaptureFixture,
) -> None:
    caplog.set_level(logging.DEBUG)
    source, shown = form.source.replace(ADDRESS, closed), form.shown.replace(ADDRESS, closed)
    code, said = typed(capsys, "config", "check", str(written(tmp_path, source, "rate = 0")))
    assert (code, leaks(said)) == (2, [])
    file = str(written(tmp_path, source))
    code, said = typed(capsys, "config", "check", file)
    valid = form.valid and bool(shown)
    assert (code, leaks(said)) == (0 if valid else 2, [])
    assert f'source = "{shown}"' in said or not valid
    code, said = typed(capsys, "cameras", file, "--out", str(tmp_path / "pictures"))
    assert (code, leaks(said)) == (1, [])
    assert shown in said
    config = load_config(file if valid else written(tmp_path, "folder:nothing"))
    status = failed(source, config)
    assert leaks(status.reason) == []
    said = driven(config, status, monkeypatch)
    assert leaks(said) == []
    (tmp_path / "state" / "logs").mkdir(exist_ok=True)
    (tmp_path / "state" / "logs" / LOG).write_text(caplog.text)
    out = str(tmp_path / "found.zip")
    code, said = typed(capsys, "incident", "--last", "60s", "--config", file, "--out", out)
    if valid:
        assert (code, leaks(said)) == (0, [])
        with zipfile.ZipFile(out) as packed:
            assert f'source = "{shown}"' in packed.read("config.toml").decode()
    found = {name: leaks(data.decode(errors="replace")) for name, data in contents(tmp_path)}
    assert not any(found.values()), found
    assert {"status.json", LOG} <= set(found)


@pytest.mark.parametrize("name", ["user-pw", "curl -u", "an environment", "ffmpeg's headers"])
def test_what_a_program_says_is_still_of_use(
    name: str, closed: str, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO)
    source = PIPES[name].source.replace(ADDRESS, closed)
    assert "ended with exit code 3" in failed(source, load_config(written(tmp_path, source))).reason
    assert "401 Unauthorized: cannot open" in caplog.text


def test_the_daemon_records_and_logs_no_secret(
    closed: str, tmp_path: Path, caplog: pytest.LogCaptureFixture, capfd: pytest.CaptureFixture[str]
) -> None:
    caplog.set_level(logging.INFO)
    painted.register()
    source = PIPES["user-pw"].source.replace(ADDRESS, closed)
    path = written(tmp_path, source)
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as radio:
        radio.bind(("127.0.0.1", 0))
        more = f'[perceiver]\nname = "painted"\n[link]\nurl = "udpout:127.0.0.1:{radio.getsockname()[1]}"\n'
        path.write_text(path.read_text() + more + "[recording]\nsize = 20\n[words]\ngrass = 1.0\n")
        state, deadline = tmp_path / "state", time.monotonic() + 20.0

        def told() -> bool:
            status, log = state / "status.json", state / "logs" / LOG
            heard = status.is_file() and "exit code 3" in status.read_text() and "401" in log.read_text()
            recorded = list((state / FOLDER).glob("*.mcap")) if (state / FOLDER).is_dir() else []
            return (heard and bool(recorded)) or time.monotonic() > deadline

        assert run.main(load_config(path), told, vision=painted.COMMAND) == 0
    assert main(["incident", "--last", "60s", "--config", str(path), "--out", str(tmp_path / "it.zip")]) == 0
    found = {name: leaks(data.decode(errors="replace")) for name, data in contents(tmp_path)}
    assert not any(found.values()), found
    assert {"status.json", LOG, "recording.mcap", "config.toml"} <= set(found)
    assert leaks("".join(capfd.readouterr())) == []


@pytest.mark.slow
@pytest.mark.parametrize("name", ["user-pw", "curl -u"])
def test_evidence_with_what_a_check_says_has_no_secret(
    name: str, closed: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    more = '[link]\nurl = "udpin:127.0.0.1:0"\n'
    path, out = written(tmp_path, PIPES[name].source.replace(ADDRESS, closed), more), tmp_path / "it.zip"
    code, said = typed(capsys, "evidence", str(path), "--out", str(out))
    assert (code, leaks(said)) == (0, [])
    found = {name: data.decode(errors="replace") for name, data in contents(tmp_path)}
    assert not any(leaks(content) for content in found.values())
    rows = json.loads(found["evidence.json"])["parts"]["check"]["tables"][0]["rows"]
    (camera,) = [row for row in rows if row["check"] == "camera"]
    assert camera["verdict"] == "fail"
    assert "exit code 3" in camera["what"]
