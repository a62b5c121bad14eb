"""The mistakes that are made most in a TOML file are told with what to write instead, and their line."""

from __future__ import annotations

from pathlib import Path

import pytest
from hypothesis import given
from hypothesis import strategies as st

from companion.config.toml_file import ConfigError, Layer
from companion.config.toml_mistakes import mistake


def _told(text: str) -> str:
    with pytest.raises(ConfigError) as refused:
        Layer.parse(Path("companion.toml"), text.encode())
    return str(refused.value)


@pytest.mark.parametrize(
    ("line", "told"),
    [
        ("height = 0,35", "height: write height = 0.35, with a decimal point"),
        ("tilt = -1,5  # degrees", "tilt: write tilt = -1.5, with a decimal point"),
        ("size = 1,000.5", "size: write size = 1000.5, without a comma"),
        ("roll = .5", "roll: write roll = 0.5"),
        ("roll = -5.", "roll: write roll = -5.0"),
        ("roll = 05", "roll: write roll = 5"),
        ("height = 35 cm", "height: write height = 35, the number alone, without a unit"),
        ("tilt = 12°", "tilt: write tilt = 12, the number alone, without a unit"),
        ("speed = 1.5m/s", "speed: write speed = 1.5, the number alone, without a unit"),
        ("loop = True", "loop: write loop = true, in small letters, without quotes"),
        ("loop = yes", "loop: write loop = true, in small letters, without quotes"),
        ("loop = FALSE # no", "loop: write loop = false, in small letters, without quotes"),
        ("loop = off", "loop: write loop = false, in small letters, without quotes"),
        ("width = None", "width: it has no value: write one, or take the line out, so that it is unset"),
        ("width =", "width: it has no value: write one, or take the line out, so that it is unset"),
        ("source = v4l2:/dev/video0", 'source: text stands in quotes: source = "..."'),
        ("file = /etc/x", 'file: text stands in quotes: file = "..."'),
        ("file = “vehicles/rover.toml”", 'file: text stands in straight quotes: file = "..."'),
        ('file = "rover.toml', 'file: the closing " of the text is missing'),
        (r'file = "C:\Users\x"', r"file: a \ in a text stands in single quotes: file = '...'"),
        ("height: 0.35", "height: write = in place of : after height"),
        ("dry grass = 1.0", 'dry grass: a name with a space in it stands in quotes: "dry grass" = ...'),
    ],
)
def test_a_mistake_is_told_with_its_line_and_what_to_write(line: str, told: str) -> None:
    assert _told(f"# first\n[mount]\n{line}\n") == f"companion.toml:3: {told}"


def test_a_setting_that_stands_twice_is_told() -> None:
    assert _told("a = 1\nb = 2\na = 3\n") == "companion.toml:3: a: it stands twice: keep one"


def test_another_mistake_is_told_as_the_parser_does() -> None:
    assert _told("[camera\n").endswith("mend the TOML")
    assert _told("a = [1 2]\n").endswith("mend the TOML")


def test_no_value_that_may_be_a_secret_is_repeated() -> None:
    for line in (
        "token = hunter2",
        "token: hunter2",
        'token = "hunter2',
        "token = “hunter2”",
        "token = 'hunter2",
    ):
        assert "hunter2" not in _told(f"[web]\n{line}\n")


@given(st.text(max_size=60))
def test_any_line_is_looked_at_without_an_error(line: str) -> None:
    key, instead = mistake(line)
    assert not instead or key
