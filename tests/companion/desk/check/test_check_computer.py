"""The rows about this computer: against real files, a real program called systemctl, and figures as told."""

from __future__ import annotations

import os
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from tempfile import TemporaryDirectory
from types import SimpleNamespace
from typing import Any

import pytest

from anytraverse.release import own_version, to_install
from companion.config import load_config
from companion.desk.check import computer, rights
from companion.desk.check.computer import (
    check_clock,
    check_heat,
    check_load,
    check_service,
    check_space,
    check_speed,
    check_versions,
)
from companion.desk.check.here import check_journal
from companion.desk.check.rights import check_reach, check_rights
from companion.desk.check.rover import CheckedRover
from companion.desk.check.rules import CheckFinding, Verdict
from companion.storage import Journal
from tests.anytraverse.bundle.conftest import write_bundle
from tests.companion.cameras.test_calibration import ROS


def rover(
    folder: Path, running: Mapping[str, Any] | None = None, more: str = "", **options: Any
) -> CheckedRover:
    path = folder / "companion.toml"
    path.write_text(f'[web]\nlisten = ""\n[vehicle]\nfile = ""\n[journal]\nfolder = "state"\n{more}')
    return CheckedRover(load_config(str(path)), str(path), folder / "state", running, **options)


def only(findings: list[CheckFinding]) -> tuple[str, str]:
    (finding,) = findings
    return finding.verdict.name.lower(), finding.text


def test_the_installed_packages_are_told(tmp_path: Path) -> None:
    verdict, text = only(check_versions(rover(tmp_path)))
    assert verdict == "pass"
    assert text.startswith(f"companion {own_version()}, Python 3.")
    for package in ("numpy", "pymavlink", "opencv-python", "onnxruntime"):
        assert f"{package}" in text


@pytest.mark.parametrize(
    ("installed", "told"),
    [
        ({"numpy": "2.0"}, f"pymavlink, cv2, onnxruntime not installed: {to_install('rover')}"),
        (
            {"numpy": "2", "pymavlink": "2", "opencv-python": "4", "opencv-python-headless": "4"},
            "opencv-python-headless and opencv-python overwrite each other",
        ),
        (
            dict.fromkeys(("numpy", "pymavlink", "opencv-python", "onnxruntime", "onnxruntime-gpu"), "1"),
            "onnxruntime and onnxruntime-gpu overwrite each other",
        ),
    ],
)
def test_missing_and_twofold_packages_fail(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, installed: dict[str, str], told: str
) -> None:
    monkeypatch.setattr(computer, "_installed", installed.get)
    verdict, text = only(check_versions(rover(tmp_path)))
    assert (verdict, told in text) == ("fail", True), text


def test_a_companion_that_runs_an_older_release_is_to_be_restarted(tmp_path: Path) -> None:
    verdict, text = only(check_versions(rover(tmp_path, {"version": "0.0.1"})))
    assert verdict == "warn"
    assert text.startswith(f"0.0.1 runs, and {own_version()} is installed")


@pytest.mark.parametrize(
    ("script", "verdict", "told"),
    [
        (
            "printf '%s\\n' LoadState=loaded ActiveState=active UnitFileState=enabled NRestarts=2",
            "pass",
            "again 2 x",
        ),
        (
            "printf '%s\\n' LoadState=loaded ActiveState=failed UnitFileState=enabled",
            "fail",
            "journalctl -u companion",
        ),
        (
            "printf '%s\\n' LoadState=loaded ActiveState=inactive UnitFileState=disabled",
            "warn",
            "systemctl enable",
        ),
        (
            "printf '%s\\n' LoadState=not-found ActiveState=inactive UnitFileState=",
            "warn",
            "systemd/install.sh",
        ),
        ("echo System has not been booted with systemd >&2; exit 1", "skip", "no systemd answers"),
        ("exec sleep 60", "skip", "no systemd answers"),
        ("echo", "skip", "no systemd answers"),
    ],
)
def test_systemd_is_asked_about_the_service(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, script: str, verdict: str, told: str
) -> None:
    (tmp_path / "systemctl").write_text(f"#!/bin/sh\n{script}\n")
    (tmp_path / "systemctl").chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=os.pathsep)
    monkeypatch.setattr(computer, "_PATIENCE", 0.3 if "sleep" in script else 10.0)
    found = only(check_service(rover(tmp_path)))
    assert (found[0], told in found[1]) == (verdict, True), found


def test_inside_the_companion_no_program_is_started(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PATH", "")
    monkeypatch.setattr("companion.desk.check.computer.subprocess.run", None)
    assert only(check_service(rover(tmp_path, {"service": True}, inside=True)))[0] == "pass"
    verdict, text = only(check_service(rover(tmp_path, {"service": False}, inside=True)))
    assert verdict == "warn"
    assert "started by hand" in text
    monkeypatch.setenv("container", "oci")
    verdict, text = only(check_service(rover(tmp_path, {"service": False}, inside=True)))
    assert (verdict, "what runs it has to start it" in text) == ("skip", True)


@pytest.fixture
def opened() -> Iterator[Path]:
    """A folder that everybody may enter, unlike pytest's own."""
    with TemporaryDirectory() as folder:
        Path(folder).chmod(0o755)
        yield Path(folder)


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can own files as somebody else")
def test_a_calibration_that_the_service_s_user_may_not_read_is_told(opened: Path) -> None:
    (opened / "lens.yaml").write_text(ROS)
    (opened / "lens.yaml").chmod(0o600)
    one = rover(opened, more='[camera]\nsource = "folder:pictures"\ncalibration = "lens.yaml"\n')
    one.folder.mkdir()
    os.chown(one.folder, 65534, 65534)
    verdict, text = only(check_rights(one))
    assert verdict == "fail"
    assert f"nobody may not read {opened}/lens.yaml" in text


@pytest.mark.skipif(os.geteuid() != 0, reason="only root can own files as somebody else")
def test_what_the_service_s_user_may_not_use_is_told_with_what_to_type(opened: Path) -> None:
    one = rover(opened, more='[link]\nsigning_key = "key"\n[camera]\nsource = "folder:pictures"\n')
    (opened / "key").write_text("secret")
    (opened / "key").chmod(0o600)
    one.folder.mkdir()
    os.chown(one.folder, 65534, 65534)
    (finding,) = check_rights(one)
    assert finding.verdict is Verdict.FAIL
    assert "nobody may not read" in finding.text
    assert f"sudo chown nobody {opened}/key" in finding.text
    os.chown(opened / "key", 65534, 65534)
    verdict, text = only(check_rights(one))
    assert (verdict, text[:41]) == ("pass", "user nobody may use its files and devices")
    assert "its processes are not kept apart" in text
    opened.chmod(0o700)
    assert len(check_rights(one)) == 3, "nothing below a folder that cannot be entered can be used"


def test_what_the_service_needs_in_a_home_folder_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    one = rover(tmp_path, more='[perceiver]\nname = "clipseg:/home/pi/clipseg"\n')
    one.folder.mkdir()
    assert only(check_rights(one))[0] == "pass", "no service"
    monkeypatch.setattr(rights, "SERVICE", one.folder)
    assert only(check_rights(one)) == (
        "fail",
        "the service does not see /home/pi/clipseg: move it out of the home folder, e.g. to /opt",
    )


def test_the_service_s_vision_process_has_a_user_of_its_own(
    opened: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    one = rover(opened, more=f'[camera]\nsource = "folder:{opened}/pictures"\n')
    one.folder.mkdir()
    pictures = opened / "pictures"
    pictures.mkdir(mode=0o700)
    monkeypatch.setattr(rights, "SERVICE", one.folder)
    verdict, text = only(check_rights(one))
    assert (verdict, text.partition(":")[0]) == ("fail", f"user anytraverse-vision may not read {pictures}")
    pictures.chmod(0o755)
    verdict, text = only(check_rights(one))
    assert (verdict, text.rpartition(", ")[2]) == ("pass", "anytraverse-vision the camera's")


def test_each_file_of_a_bundle_must_be_readable_to_the_vision_process(
    opened: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    one = rover(opened, more='[perceiver]\nname = "clipseg:eyes"\n')
    one.folder.mkdir()
    monkeypatch.setattr(rights, "SERVICE", one.folder)
    write_bundle(opened / "eyes")
    for path in (opened / "eyes").rglob("*"):
        path.chmod(0o755)
    assert only(check_rights(one))[0] == "pass"
    (opened / "eyes/notes.txt").touch(0o600)
    assert only(check_rights(one))[0] == "pass", "no part of the bundle"
    weights = opened / "eyes/image.onnx"
    weights.chmod(0o600)
    verdict, text = only(check_rights(one))
    assert (verdict, text.partition(":")[0]) == ("fail", f"user anytraverse-vision may not read {weights}")


def test_a_relative_path_of_a_camera_begins_where_the_service_runs(
    opened: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    one = rover(opened, more='[camera]\nsource = "video:drive.mp4"\n')
    one.folder.mkdir()
    monkeypatch.setattr(rights, "SERVICE", one.folder)
    (one.folder / "drive.mp4").touch(0o600)
    verdict, text = only(check_rights(one))
    assert (verdict, text.partition(":")[0]) == (
        "fail",
        f"user anytraverse-vision may not read {one.folder}/drive.mp4",
    )


@pytest.mark.parametrize(
    ("source", "limited", "verdict", "text"),
    [
        ("v4l2:/dev/video0", False, "pass", "the vision process has no network"),
        (
            "rtsp://10.0.0.7/",
            True,
            "pass",
            "of the network systemd lets the vision process reach 10.0.0.7/32",
        ),
        ("rtsp://10.0.0.7/", False, "warn", "this system does not limit it"),
        ("rtsp://camera.local/", True, "warn", "write the camera's numeric address"),
        ("oak:192.168.1.222", True, "warn", 'with one OAK, on USB, write "oak:"'),
        ("pipe:ffmpeg -i rtsp://10.0.0.7/ -", True, "warn", 'write "v4l2:" or "rtsp://ADDRESS/PATH"'),
        ("oak:", True, "pass", "of the network systemd lets the vision process reach nothing"),
    ],
)
def test_how_much_of_the_network_the_vision_process_reaches_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, source: str, limited: bool, verdict: str, text: str
) -> None:
    form = 'width = 640\nheight = 480\npixel_format = "yuv420p"\n' if source.startswith("pipe:") else ""
    one = rover(tmp_path, more=f'[camera]\nsource = "{source}"\n{form}')
    assert only(check_reach(one))[0] == "skip"
    monkeypatch.setattr(rights, "SERVICE", one.folder)
    monkeypatch.setattr(rights, "_UNIFIED", tmp_path)
    monkeypatch.setattr(rights, "is_limited", lambda _needs: limited)
    found = only(check_reach(one))
    assert found[0] == verdict
    assert text in found[1]


def test_a_camera_s_command_or_url_is_no_file_of_which_rights_are_checked(tmp_path: Path) -> None:
    command = f"pipe:/usr/bin/rpicam-vid {'-n ' * 100}-o -"
    more = f'[camera]\nsource = "{command}"\nwidth = 640\nheight = 480\npixel_format = "yuv420p"\n'
    one = rover(tmp_path, more=more)
    one.folder.mkdir()
    if os.geteuid() == 0:  # who may all
        os.chown(one.folder, 65534, 65534)
    assert not any("rpicam-vid" in finding.text for finding in check_rights(one))


def test_a_serial_device_is_opened_by_its_group(opened: Path) -> None:
    user = rights._User("rover", 12345, frozenset({54321}))
    device = opened / "ttyAMA0"
    device.touch()
    device.chmod(0o660)
    assert not rights._may(user, device, 6)
    if os.geteuid() == 0:
        os.chown(device, 0, 54321)
        assert rights._may(user, device, 6)
        assert not rights._may(user._replace(groups=frozenset()), device, 4)
    device.chmod(0o666)
    assert rights._may(user._replace(groups=frozenset()), device, 6)


@pytest.mark.parametrize(("free", "verdict"), [(10, "fail"), (400, "warn"), (4000, "pass")])
def test_room_on_the_disk_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, free: int, verdict: str
) -> None:
    monkeypatch.setattr(
        "companion.desk.check.computer.shutil.disk_usage", lambda _: SimpleNamespace(free=free << 20)
    )
    found = only([check_space(tmp_path / "not/yet")])
    assert found[0] == verdict
    assert found[1].startswith(f"{free} MiB free at {tmp_path}")


@pytest.mark.parametrize(("seconds", "verdict"), [(0.02, "pass"), (0.7, "warn"), (2.5, "fail")])
def test_a_slow_disk_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, seconds: float, verdict: str
) -> None:
    now, synced = 0.0, 0

    def fsync(_: int) -> None:
        nonlocal now, synced
        synced += 1
        now += seconds if synced == 1 else 0.001

    monkeypatch.setattr("companion.desk.check.computer.os.fsync", fsync)
    monkeypatch.setattr("companion.desk.check.computer.time.monotonic", lambda: now)
    found = only(check_speed(rover(tmp_path)))
    assert found[0] == verdict
    assert f"after {1e3 * seconds:.0f} ms" in found[1]
    assert [path.name for path in tmp_path.iterdir()] == ["companion.toml"], "nothing is left behind"


@pytest.mark.parametrize(
    ("disk", "verdict"),
    [
        ({"failing": True, "errors": {}, "dropped": {}}, "fail"),
        ({"failing": False, "errors": {"picture": 2}, "dropped": {}}, "warn"),
        ({"failing": False, "errors": {}, "dropped": {"log": 2}}, "warn"),
        ({"failing": False, "errors": {}, "dropped": {}}, "pass"),
    ],
)
def test_a_companion_that_runs_says_how_the_disk_does(
    tmp_path: Path, disk: dict[str, Any], verdict: str
) -> None:
    assert only(check_speed(rover(tmp_path, {"disk": disk})))[0] == verdict


def test_a_journal_that_can_be_read_is_told_and_a_damaged_one_too(tmp_path: Path) -> None:
    one = rover(tmp_path)
    assert only(check_journal(one))[1] == f"{one.folder} can be made"
    Journal(one.folder).close()
    assert only(check_journal(one))[1] == f"{one.folder} can be written"
    (one.folder / "journal.db").write_bytes(b"")
    verdict, text = only(check_journal(one))
    assert (verdict, "is damaged: start the companion" in text) == ("warn", True)


@pytest.mark.parametrize(
    ("now", "key", "rtc", "verdict", "told"),
    [
        (1_800_000_000.0, False, True, "pass", "2027-01-1"),
        (1_800_000_000.0, False, False, "pass", "it has no battery"),
        (1000.0, False, False, "warn", "never set: let network or autopilot (GNSS) tell the time"),
        (1000.0, True, False, "warn", "it sends nothing until a signed frame tells the time"),
    ],
)
def test_a_clock_without_battery_or_never_set_is_told(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    now: float,
    key: bool,
    rtc: bool,
    verdict: str,
    told: str,
) -> None:
    monkeypatch.setattr(computer, "_RTC", tmp_path if rtc else tmp_path / "none")
    monkeypatch.setattr(time, "time", lambda: now)
    found = only(check_clock(rover(tmp_path, more='[link]\nsigning_key = "key"\n' if key else "")))
    assert (found[0], told in found[1]) == (verdict, True), found


@pytest.mark.parametrize(
    ("figures", "verdict", "told"),
    [
        ({"temperature": 61.2, "throttled": False}, "pass", "61 C"),
        ({"temperature": 61.2, "throttled": None}, "pass", "61 C"),
        ({"temperature": 82.0, "throttled": False}, "warn", "cool it, since a slow computer sees late"),
        ({"temperature": 61.2, "throttled": True}, "warn", "61 C, the CPU is slowed down"),
        ({"temperature": 96.0, "throttled": True}, "fail", "about to switch off"),
        ({"temperature": None, "throttled": True}, "warn", "slowed down"),
        ({"temperature": None, "throttled": None}, "skip", "not known"),
        ({"temperature": 40.0, "under_voltage": True}, "warn", "take a better supply"),
    ],
)
def test_heat_throttling_and_supply_are_told(
    tmp_path: Path, figures: dict[str, Any], verdict: str, told: str
) -> None:
    found = only(check_heat(rover(tmp_path, {"computer": figures})))
    assert (found[0], told in found[1]) == (verdict, True), found


@pytest.mark.parametrize(
    ("figures", "verdict", "told"),
    [
        ({"cpu": 0.4, "memory": 1994, "memory_free": 800}, "pass", "CPU 40 %, 800 of 1994 MiB memory free"),
        ({"cpu": 0.99, "memory": 1994, "memory_free": 800}, "warn", "`top` shows which program"),
        ({"cpu": 0.4, "memory": 1994, "memory_free": 100}, "warn", "take a smaller model"),
        ({"cpu": None, "memory": 1994, "memory_free": 800}, "pass", "800 of 1994"),
        ({"cpu": None, "memory": None, "memory_free": None}, "skip", "tells neither"),
    ],
)
def test_load_is_told(tmp_path: Path, figures: dict[str, Any], verdict: str, told: str) -> None:
    found = only(check_load(rover(tmp_path, {"computer": figures})))
    assert (found[0], told in found[1]) == (verdict, True), found


def test_fewer_frames_than_configured_are_told_with_their_cause(tmp_path: Path) -> None:
    judging = {"rate": 5.0, "configured": 10.0, "lowered_by": "slow computer"}
    computer = {"cpu": 0.9, "memory": 1994, "memory_free": 800}
    verdict, told = only(check_load(rover(tmp_path, {"computer": computer, "judging": judging})))
    assert verdict == "warn"
    assert "CPU 90 %, 800 of 1994 MiB memory free, judges 5.0 frames/s of 10.0 (slow computer): `top`" in told
    well = {"computer": computer, "judging": {**judging, "rate": 10.0, "lowered_by": ""}}
    assert only(check_load(rover(tmp_path, well)))[0] == "pass"


def test_without_a_companion_this_computer_is_measured(tmp_path: Path) -> None:
    one = rover(tmp_path)
    assert one.computer["memory_free"] > 0
    assert 0 <= one.computer["cpu"] <= 1
    assert only(check_load(one))[0] in ("pass", "warn")
