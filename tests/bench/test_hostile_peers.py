"""What attacks with the key, as a rover, as a camera and by recordings is as hostile as it says."""

from __future__ import annotations

import io
import json
import os
import subprocess
import sys
import time
import urllib.request
import zipfile
from collections.abc import Callable
from contextlib import closing
from pathlib import Path

import pytest

from anytraverse.picture_size import jpeg_size
from bench.attack.clock import DAY, AheadSender, _environment
from bench.attack.hostile_camera import GOOD, HostileCamera
from bench.attack.hostile_rover import EVIL, INCIDENT, SYSTEM, HostilePage, HostileRover
from bench.attack.outcome import peak_memory
from bench.attack.recordings import CANARY, ESCAPE, WAYS, _run
from bench.attack.stations import _texts
from companion.cameras import CameraError, CameraOptions, open_camera
from companion.wire.signing import AHEAD, REPLAY, SigningKey, Timestamps, refusal, ticks
from gcs_plugin.client.client import OperatorClient
from gcs_plugin.client.fetch import FetchStatus
from gcs_plugin.terminal.connection import open_connection
from gcs_plugin.terminal.runner import Runner

KEY = SigningKey(bytes(range(32)))


def test_senders_are_as_far_ahead_as_they_say_and_sign_with_the_key() -> None:
    now, timestamps = ticks(time.time()), Timestamps()
    near = AheadSender(KEY, DAY / 2, 250).weight(-1.0)
    assert [refusal(near, KEY, timestamps, now, synchronised=True) for _ in range(2)] == ["", REPLAY]
    far = AheadSender(KEY, 365 * DAY, 251)
    assert refusal(far.beat(), KEY, timestamps, now, synchronised=True) == AHEAD
    assert refusal(far.beat(), KEY, timestamps, now) == ""


@pytest.mark.parametrize("is_set", [True, False])
def test_a_companion_believes_what_the_attack_says_of_its_clock(tmp_path: Path, is_set: bool) -> None:
    ask = "from companion.system.computer import is_synchronised; print(is_synchronised())"
    environment = {**os.environ, **_environment(tmp_path, is_set)}
    said = subprocess.check_output([sys.executable, "-c", ask], env=environment, text=True)
    assert said.strip() == str(is_set)


def test_a_hostile_rover_serves_its_files_and_floods() -> None:
    connection, client = open_connection("udpin:127.0.0.1:0"), OperatorClient()
    address = "127.0.0.1", int(connection.name.rpartition(":")[2])
    with closing(Runner(connection, client)) as station, closing(HostileRover(address)) as rover:

        def turn_until(fits: Callable[[], bool]) -> None:
            deadline = time.monotonic() + 20.0
            while not fits():
                assert time.monotonic() < deadline
                rover.step()
                station.step(time.monotonic())

        def fetched(path: str) -> bytes:
            fetch = client.fetch(SYSTEM, path, time.monotonic())
            turn_until(lambda: fetch.settled)
            assert fetch.status is FetchStatus.DONE
            return fetch.content

        turn_until(lambda: SYSTEM in client.rovers)
        assert jpeg_size(fetched("/calls/1.jpg")) is not None
        assert EVIL in json.loads(fetched("/calls/1.json"))["why"]
        rover.floods = True
        turn_until(lambda: len(client.rovers) > 10 and any(one.texts for one in client.rovers.values()))


def test_a_hostile_page_serves_a_zip_of_many_members_and_one_without_end() -> None:
    with closing(HostilePage(50)) as page:
        whole = urllib.request.urlopen(f"{page.url}/incidents/{INCIDENT}.zip").read()
        assert len(zipfile.ZipFile(io.BytesIO(whole)).namelist()) == 50
        with urllib.request.urlopen(f"{page.url}/incidents/{INCIDENT}-short.zip") as endless:
            assert len(endless.read(len(whole) * 100)) == len(whole) * 100


def test_all_texts_of_what_a_page_shows_are_looked_at() -> None:
    assert list(_texts({"a": ["b", {"c": "d"}, 1, None]})) == ["a", "b", "c", "d"]


def test_a_hostile_camera_is_good_until_it_is_not() -> None:
    with closing(HostileCamera()) as hostile:
        assert hostile.way == GOOD
        with closing(open_camera(hostile.source, CameraOptions())) as camera:
            assert camera.read(1.0).image.shape == (96, 128, 3)
        hostile.way = "pictures of 108 million pixels"
        with pytest.raises(CameraError, match="at most 50 million"):
            open_camera(hostile.source, CameraOptions())


@pytest.mark.parametrize("name", ["a pipe", "settings that name files"])
def test_what_a_command_says_and_takes_is_looked_at(tmp_path: Path, name: str) -> None:
    canary = tmp_path / "canary.toml"
    canary.write_text(f'words = {{ "{CANARY}" = 1.0 }}')
    WAYS[name](tmp_path / "000001.mcap", canary)
    took, megabytes, code, said = _run(["replay", str(tmp_path / "000001.mcap")], tmp_path)
    assert took < 20.0
    assert megabytes > 10
    assert code in (1, 2)
    assert said
    assert CANARY not in said
    assert ESCAPE not in said


def test_the_memory_of_a_process_is_told_until_it_ends() -> None:
    assert peak_memory(os.getpid()) > 10
    with subprocess.Popen(["true"]) as ended:
        ended.wait()
    assert peak_memory(ended.pid) == 0
