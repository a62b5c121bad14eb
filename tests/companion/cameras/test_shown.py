"""What may be shown of a source: enough to tell which camera it is, and nothing that may be a secret."""

from __future__ import annotations

import re

import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.cameras.shown import address, plain_words, program, shown
from tests.companion.cameras.sources import FORMS, SECRETS, Form


@pytest.mark.parametrize("form", FORMS.values(), ids=FORMS)
def test_of_each_form_only_what_is_harmless_is_shown(form: Form) -> None:
    for host in ("192.168.1.64:554", "[fd00::64]:8554", "10.0.0.2"):
        told = shown(form.source.replace("ADDRESS", host))
        assert not any(secret in told for secret in SECRETS)
        assert not form.shown or told == form.shown.replace("ADDRESS", host)


@pytest.mark.parametrize(
    "text",
    [
        "rtsp://camera.local:554",
        "v4l2:/dev/v4l/by-path/pci-0000:00:14.0-usb-0:1:1.0-video-index0",
        "v4l2:0",
        "oak:",
        "oak:1944301091781D1300",
        "field:127.0.0.1:5600",
        "video:drive.mp4",
        "folder:/data/2026-11-26 (second), user@work=1",
        "pipe:rpicam-hello",
        "udpin:0.0.0.0:14550",
        "tcp:127.0.0.1:5760",
        "serial:/dev/ttyAMA0:57600",
        "127.0.0.1:8191",
        "[::1]:8191",
        "localhost:0",
        "/etc/anytraverse/signing.key",
        "~/state",
        "vehicles/rover.toml",
        "",
    ],
)
def test_what_holds_no_secret_is_shown_as_it_is(text: str) -> None:
    assert shown(text) == text


_SIGNS = st.text("ab09!#$%&()*+,;=:@/?._~ '\"\\-", max_size=12)
_KINDS = st.sampled_from(["rtsp", "RTSP", "http", "https", "rtmp", "srt", "rstp", "video", "v4l2", "oak", ""])


@given(_KINDS, st.sampled_from(["://", ":/", ":", "//"]), _SIGNS, _SIGNS)
def test_no_password_before_a_host_is_shown_whatever_signs_it_has(
    kind: str, separator: str, before: str, after: str
) -> None:
    told = shown(f"{kind}{separator}me:{before}SECRET{after}@camera.local/stream")
    assert "SECRET" not in told


@given(st.sampled_from(["rtsp", "http"]), st.text(max_size=30))
def test_nothing_behind_the_host_is_shown(kind: str, rest: str) -> None:
    told = shown(f"{kind}://camera.local:8080/{rest}SECRET")
    assert told in (f"{kind}://camera.local:8080/...", f"{kind}:...")
    assert "@" in rest or told != f"{kind}:..."


@given(st.sampled_from(["ffmpeg", "gst-launch-1.0 -q", "sh -c"]), st.text(max_size=30))
def test_no_argument_of_a_command_is_shown(command: str, rest: str) -> None:
    told = shown(f"pipe:{command} {rest}SECRET")
    assert "SECRET" not in told
    assert re.fullmatch(r"pipe:[\w.-]* ?([a-z0-9]+ )?\.\.\.", told)


@given(st.text(max_size=40))
def test_any_text_has_something_that_may_be_shown(text: str) -> None:
    assert isinstance(shown(text), str)
    assert isinstance(program(text), str)
    assert isinstance(address(text), str)
    assert isinstance(plain_words(text, text), str)


@pytest.mark.parametrize(
    ("said", "told"),
    [
        ("[rtsp @ 0x55d5] DESCRIBE failed: 401 Unauthorized", "... DESCRIBE failed: 401 Unauthorized"),
        ("/dev/video0: Device or resource busy", "... Device or resource busy"),
        ("rtsp://me:sesame@cam/1: No such file or directory", "... No such file or directory"),
        ("wrong password 'sesame'!", "wrong password ..."),
        ("wrong password 'Sesame' or 'same'", "wrong password ... or ..."),
        ("pass p@ss1 is wrong", "pass ... is wrong"),
        ("Authorization: Basic bWU6c2VzYW1l", "Authorization: Basic ..."),
        ("frame 17 of 120, 1944301 bytes", "frame 17 of 120, ... bytes"),
        ("\x1b[31mred\x1b[0m", ""),
        ("", ""),
    ],
)
def test_plain_words_of_a_program_are_told(said: str, told: str) -> None:
    assert plain_words(said, "rtsp://me:sesame@cam/1 p%40ss1") == told


@given(st.text("abcdefgh", min_size=4, max_size=12), st.text("abcdefgh \"'.:,()[]", max_size=30))
def test_no_word_of_the_source_is_told_however_it_is_cut(secret: str, around: str) -> None:
    for said in (
        secret,
        secret.upper(),
        f'"{secret}"',
        secret[1:],
        secret[:-1],
        f"x={secret}",
        f"me:{secret}",
    ):
        if len(said) > 4:
            words = plain_words(f"{around} {said} x", f"rtsp://me:{secret}@cam").split()
            assert said.strip("\"'") not in words[-2:]
