"""What is shown of a change of the configuration holds no secret."""

from __future__ import annotations

import time

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.config.shown_diff import shown_diff

SECRET = "s3cr3t"
_LETTERS = st.text("abcdefghijkmnopqrstuvwxyz0123456789", min_size=16, max_size=20)


@pytest.mark.parametrize(
    "line",
    [
        f'[web]\ntoken = "{SECRET}abcdefghijklm"',
        f"[web]\ntoken = '''\n{SECRET}abcdefghijklm'''",
        f'web.token = "{SECRET}abcdefghijklm"',
        f'web = {{ token = "{SECRET}abcdefghijklm" }}',
        f'[web]\ntoken = "{SECRET}abcdefghijklm" # mine\u2028x',
        f'[alert]\nurl = "https://ntfy.sh/{SECRET}" # mine\x85x',
        f'# token = "{SECRET}"',
        f'[web]\ntoken = ""  # was {SECRET}? token = "{SECRET}"',
        f'[camera]\nsource = "rtsp://user:{SECRET}@10.0.0.7/s"',
        f'[camera]\n# source = "rtsp://user:{SECRET}@10.0.0.7/s"',
        f"# the camera is at rtsp://user:{SECRET}@10.0.0.7/s",
        f'[camera]\nsource = "pipe:ffmpeg -i rtsp://u:{SECRET}@h/ -"',
        f'[camera]\n# source = "pipe:curl -u u:{SECRET} h"',
        f'[link.more.wifi]\nurl = "tcp:{SECRET}:x@127.0.0.1:5"',
        f'[other]\nthing = "{SECRET}"',
        f'[video]\nencoder = "x264enc key={SECRET}"',
    ],
)
def test_no_secret_is_shown_before_or_after(line: str) -> None:
    other = line.replace(SECRET, "0th3r")
    shown = shown_diff(f"# top\n{line}\n", f"# top\n{other}\n", "companion.toml")
    assert shown
    assert SECRET not in shown
    assert "0th3r" not in shown


@given(_LETTERS, _LETTERS)
@settings(max_examples=50, deadline=None)
def test_a_changed_token_is_seen_to_change_and_not_shown(before: str, after: str) -> None:
    old, new = (f'[web]\ntoken = "{token}"\nlisten = ""\n' for token in (before, after))
    shown = shown_diff(old, new, "companion.toml")
    assert bool(shown) is (before != after)
    assert before not in shown
    assert after not in shown


def test_what_is_harmless_is_shown_as_it_stands() -> None:
    before = '# a comment: 5 = five\n[camera]\nsource = "v4l2:/dev/video0"  # in front\nrate = 10.0\n'
    after = before.replace("10.0", "5.0").replace("video0", "video1") + '\n[words]\n"dry grass" = 1.0\n'
    shown = shown_diff(before, after, "companion.toml").splitlines()
    assert shown[:2] == ["--- companion.toml", "+++ companion.toml, changed"]
    assert shown[3:] == [
        " # a comment: 5 = five",
        " [camera]",
        '-source = "v4l2:/dev/video0"  # in front',
        "-rate = 10.0",
        '+source = "v4l2:/dev/video1"  # in front',
        "+rate = 5.0",
        "+",
        "+[words]",
        '+"dry grass" = 1.0',
    ]


def test_nothing_is_shown_where_nothing_changes() -> None:
    assert shown_diff("a = 1\n", "a = 1\n", "companion.toml") == ""


def test_a_long_word_in_a_comment_takes_no_long_time() -> None:
    text = f"# {40_000 * 'x'}\n[call]\nvotes = 2\n"
    began = time.process_time()
    assert "+votes = 3" in shown_diff(text, text.replace("votes = 2", "votes = 3"), "companion.toml")
    assert time.process_time() - began < 2.0
