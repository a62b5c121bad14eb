"""The section [video]: where the MAVLink camera's video is, and what follows from it."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.config import Config, ConfigError, load_config
from companion.config.video import WIDTH, CameraSettings, check_url, video_size


def loaded(folder: Path, video: str) -> Config:
    path = folder / "companion.toml"
    path.write_text(f'vocabulary = ["rock"]\n[vehicle]\nfile = ""\n[video]\n{video}\n')
    return load_config(path)


def test_without_an_address_the_companion_is_no_camera(tmp_path: Path) -> None:
    config = loaded(tmp_path, "")
    assert config.video.camera(70.0) is None
    assert config.vocabulary == ("rock",)


def test_a_camera_offers_the_word_of_a_tap_as_a_parameter(tmp_path: Path) -> None:
    config = loaded(tmp_path, 'listen = "127.0.0.1:8554"\ncomponent = 103')
    assert config.video.camera(70.4) == CameraSettings(103, 5.0, 70)
    assert config.vocabulary == ("rock", "obstacle")


def test_an_address_that_means_any_needs_one_that_others_reach(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"set url"):
        loaded(tmp_path, 'listen = "0.0.0.0:8554"')
    url = "rtsp://rover.local:8554/anytraverse"
    assert loaded(tmp_path, f'listen = "0.0.0.0:8554"\nurl = "{url}"').video.url == url


@pytest.mark.parametrize(
    "video",
    [
        'url = "http://rover.local/"',
        f'url = "rtsp://{"x" * 160}"',
        "component = 99",
        "rate = 0.5",
        'encoder = "x264enc ! fakesink"',
        'encoder = "x264enc {rate}"',
        'encoder = ""',
        'listen = "rover.local:8554"',
    ],
)
def test_what_cannot_be_is_refused(tmp_path: Path, video: str) -> None:
    with pytest.raises(ConfigError, match=r"\[video\]|video\."):
        loaded(tmp_path, video)


@given(st.text())
def test_any_text_is_an_address_or_a_value_error(text: str) -> None:
    try:
        check_url(text)
    except ValueError:
        return
    assert text == "" or (text.startswith("rtsp://") and len(text.encode()) < 160)


@given(st.integers(1, 8192), st.integers(1, 8192))
def test_the_video_has_an_even_size_and_nearly_the_pictures_shape(height: int, width: int) -> None:
    high, wide = video_size(height, width)
    assert wide == WIDTH
    assert high % 2 == 0
    assert 2 <= high <= 3 * WIDTH
    if 0.01 < height / width < 2.9:
        assert high == pytest.approx(height * wide / width, abs=2)
