"""What can be no camera is known without opening one: by the check of a configuration as by its start."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.cameras import KINDS, SourceError, open_camera, split_source
from companion.cameras.places import absent_now
from companion.config import ConfigError, load_config


@pytest.mark.parametrize(
    ("source", "meant"),
    [
        ("/dev/video9", "v4l2:/dev/video9"),
        ("/dev/v4l/by-id/usb-x-index0", "v4l2:/dev/v4l/by-id/usb-x-index0"),
        ("v4l:/dev/video9", "v4l2:/dev/video9"),
        ("V4L2:/dev/video0", "v4l2:/dev/video0"),
        ("0", "v4l2:/dev/video0"),
        ("drive.mp4", "video:drive.mp4"),
        ("rtps://user:secret@10.0.0.7/s", "rtsp://10.0.0.7/..."),
    ],
)
def test_a_source_of_no_kind_is_told_what_was_probably_meant(source: str, meant: str) -> None:
    with pytest.raises(SourceError) as refused:
        split_source(source)
    assert f'did you mean "{meant}"?' in str(refused.value)
    assert "secret" not in str(refused.value)


@pytest.mark.parametrize(
    "source",
    [
        "rtsp:camera",
        "http://",
        "https://a:99999/",
        "rtsp://u:p/x@host/s",
        "field:10.0.0.7:1",
        "field:here",
        "pipe:'unclosed",
        "pipe: ",
        "video:",
        "folder:http://x",
    ],
)
def test_what_a_start_refuses_for_ever_the_configuration_s_check_refuses(source: str, tmp_path: Path) -> None:
    with pytest.raises(SourceError):
        open_camera(source)
    file = tmp_path / "companion.toml"
    file.write_text(f'[camera]\nsource = "{source}"\n[vehicle]\nfile = ""\n')
    with pytest.raises(ConfigError, match=r"camera\.source"):
        load_config(file)


@given(st.sampled_from([*KINDS, "x", ""]), st.text(max_size=20))
def test_any_source_is_split_or_refused_with_a_reason(kind: str, place: str) -> None:
    reason, split = "", None
    try:
        split = split_source(f"{kind}:{place}")
    except SourceError as error:
        reason = str(error)
    assert bool(reason) is (split != (kind, place))


def test_what_is_not_there_now_is_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    (tmp_path / "drive.mp4").touch()
    assert absent_now("video", "drive.mp4") == ""
    assert f"no pictures in {tmp_path} now" in absent_now("folder", "pictures")
    assert absent_now("v4l2", "/dev/video97").startswith("there is no /dev/video97 now")
    assert absent_now("v4l2", "97").startswith("there is no /dev/video97 now")
    assert "ffmpeg-of-nobody is not installed" in absent_now("pipe", "ffmpeg-of-nobody -i x")
    assert absent_now("pipe", "cat x") == ""
    assert absent_now("rtsp", "//10.0.0.7/s") == ""
