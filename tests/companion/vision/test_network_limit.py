"""What of the network a camera needs, and what systemd is asked for that."""

from __future__ import annotations

import subprocess
from pathlib import Path

import pytest

from companion.cameras import SourceError
from companion.vision import network_limit
from companion.vision.network_limit import NetworkNeeds, is_limited, main, needs_of

GSTREAMER = "pipe:gst-launch-1.0 -q"
HERE = "127.0.0.0/8", "::1/128"
NONE, UNKNOWN = NetworkNeeds(any=False), NetworkNeeds(any=True, networks=None)


@pytest.mark.parametrize(
    ("source", "needs"),
    [
        ("v4l2:/dev/video0", NONE),
        ("video:/var/lib/anytraverse/drive.mp4", NONE),
        ("folder:pictures", NONE),
        ("pipe:rpicam-vid -t 0 -n --codec yuv420 -o -", NONE),
        ("pipe:/usr/bin/libcamera-vid -o -", NONE),
        (f"{GSTREAMER} nvarguscamerasrc ! nvvidconv ! fdsink", NONE),
        (f"{GSTREAMER} v4l2src device=/dev/video0 ! fdsink", NONE),
        (f"{GSTREAMER} rtspsrc location=rtsp://10.0.0.7/main ! fdsink", UNKNOWN),
        (f"{GSTREAMER} v4l2src ! mix. udpsrc port=5600 ! mix. fdsink", UNKNOWN),
        (f"{GSTREAMER} v4l2src ! tee ! rtspclientsink location=rtsp://10.0.0.7/ ! fdsink", UNKNOWN),
        (f"{GSTREAMER} v4l2src ! tee name=t ! fdsink t. ! udpsink host=10.0.0.7", UNKNOWN),
        (f"{GSTREAMER} v4l2src ! tee name=t ! fdsink t. ! rtmp2sink", UNKNOWN),
        (f"{GSTREAMER} v4l2src ! tee name=t ! fdsink t. ! filesink location=drive.raw", NONE),
        ("pipe:rpicam-vid -t 0 -o udp://10.0.0.7:5600", UNKNOWN),
        ("pipe:ffmpeg -i /dev/video0 -", UNKNOWN),
        ("pipe:sh -c 'rpicam-vid -o -'", UNKNOWN),
        (
            "rtsp://user:rtsp%3A%2F%2F10.0.0.9@10.0.0.7:554/main",
            NetworkNeeds(any=True, networks=("10.0.0.7/32",)),
        ),
        ("http://[fe80::1]/video", NetworkNeeds(any=True, networks=("fe80::1/128",))),
        ("https://camera.local/video", UNKNOWN),
        ("rtsp://localhost:8554/", NetworkNeeds(any=True, networks=HERE)),
        ("field:127.0.0.1:7000", NetworkNeeds(any=True, networks=HERE)),
        ("oak:", NetworkNeeds(any=True)),
        ("http://[fe80::1%eth0]/video", UNKNOWN),
        ("oak:14442C10D13EABCE00", UNKNOWN),
        ("oak:192.168.1.222", UNKNOWN),
    ],
)
def test_a_camera_reaches_what_its_source_names(source: str, needs: NetworkNeeds) -> None:
    assert needs_of(source) == needs


def test_a_source_that_is_none_is_refused() -> None:
    with pytest.raises(SourceError):
        needs_of("nothing")


def test_systemd_is_told_at_the_start_what_the_configuration_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[list[str]] = []

    def run(command: list[str], **_: object) -> subprocess.CompletedProcess[str]:
        asked.append(command)
        return subprocess.CompletedProcess(command, 0)

    monkeypatch.setattr(subprocess, "run", run)
    file = tmp_path / "companion.toml"

    def told(source: str) -> list[str]:
        file.write_text(f'[camera]\nsource = "{source}"\n[vehicle]\nfile = ""\n')
        assert main(str(file)) == 0
        command = asked.pop()
        assert command[:4] == ["systemctl", "set-property", "--runtime", "companion-camera.slice"]
        return command[4:]

    forgotten = ["IPAddressDeny=", "IPAddressAllow="]
    denied = [*forgotten, "IPAddressDeny=any"]
    assert told("rtsp://u:p@10.0.0.7/main") == [*denied, "IPAddressAllow=10.0.0.7/32"]
    assert told("oak:") == denied
    assert told("rtsp://u:p@camera.local/main") == forgotten
    file.write_text("nonsense")
    assert (main(str(file)), asked) == (1, [])


def test_it_is_limited_when_systemd_was_told_these_networks_and_no_other(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(network_limit, "_TOLD", tmp_path)
    camera, oak = needs_of("rtsp://10.0.0.7/"), needs_of("oak:")
    assert not is_limited(camera)
    (tmp_path / "50-IPAddressAllow.conf").write_text("[Slice]\nIPAddressAllow=\nIPAddressAllow=10.0.0.7/32\n")
    assert not is_limited(camera)
    (tmp_path / "50-IPAddressDeny.conf").write_text("[Slice]\nIPAddressDeny=\nIPAddressDeny=0.0.0.0/0\n")
    assert is_limited(camera)
    assert not is_limited(oak)
    assert not is_limited(UNKNOWN)
