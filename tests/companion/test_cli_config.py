"""How a command is told its configuration: one rule for all of them, and the older spellings."""

from __future__ import annotations

import argparse
import re
import subprocess
import sys
from pathlib import Path

import pytest

from anytraverse.release import to_install
from companion import cli_config
from companion.cli import main, parser
from companion.system import side_process

ALONE = (
    "run",
    "check",
    "cameras",
    "setup",
    "status",
    "config check",
    "memory list",
    "record list",
    "evidence",
)
BESIDE = (
    "memory show 1",
    "memory forget 1 2",
    "memory export FILE",
    "memory import FILE",
    "look-ground PICTURE",
    "costmap RECORDING",
    "rehearse DRIVE",
    "replay DRIVE",
    "tune DRIVE",
    "incident C7",
    "config set CAMERA.RATE=5",
)
NONE = {"demo", "init", "config schema", "record repair"}
"""Commands about no configuration."""


def parsed(*words: str) -> argparse.Namespace:
    return parser().parse_args(words)


@pytest.mark.parametrize("command", ALONE)
def test_a_command_about_nothing_else_takes_the_file_alone_or_by_its_option(command: str) -> None:
    words = command.split()
    assert parsed(*words, "a.toml").config == "a.toml"
    assert parsed(*words, "--config", "a.toml").config == "a.toml"
    assert parsed(*words).config is None


@pytest.mark.parametrize("command", BESIDE)
def test_a_command_about_another_thing_takes_the_file_by_its_option(command: str) -> None:
    words = command.split()
    assert parsed(*words, "--config", "a.toml").config == "a.toml"


def test_every_command_follows_the_rule() -> None:
    known = {" ".join(word for word in command.split() if word.islower()) for command in (*ALONE, *BESIDE)}
    assert set(_commands(parser())) == known | NONE


def test_two_configurations_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        parsed("status", "a.toml", "--config", "b.toml")
    assert ended.value.code == 2
    assert "not allowed with" in capsys.readouterr().err


def test_by_default_it_is_the_folders_and_else_the_services(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    service = tmp_path / "service.toml"
    monkeypatch.setattr(cli_config, "SERVICE", str(service))
    monkeypatch.chdir(tmp_path)
    assert main(["config", "check"]) == 2
    assert "companion config: companion.toml: " in capsys.readouterr().err, "there is none"
    service.write_text("[camera]\nrate = 0\n")
    assert main(["config", "check"]) == 2
    assert f"companion config: by {service}\n" in capsys.readouterr().err
    Path("companion.toml").write_text("[camera]\nrate = 0\n")
    assert main(["config", "check"]) == 2
    assert capsys.readouterr().err.startswith("companion config: by companion.toml\n")


def _commands(within: argparse.ArgumentParser, before: str = "") -> list[str]:
    below = [
        one
        for action in within._actions
        if isinstance(action, argparse._SubParsersAction)
        for one in action.choices.items()
    ]
    if not below:
        return [before.strip()]
    return [name for word, one in below for name in _commands(one, f"{before} {word}")]


@pytest.mark.parametrize(
    "words", [["rehearse", "drive"], ["tune", "drive"], ["costmap", "drive"], ["run"], ["cameras"]]
)
def test_a_missing_package_is_told_with_what_installs_it(
    words: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    bare = "import sys; sys.modules.update(dict.fromkeys(('numpy', 'cv2')))\n"
    script = f"{bare}from companion.cli import main\nsys.exit(main({words!r}))"
    monkeypatch.setenv("PYTHONPATH", str(Path(__file__).parents[2]))
    (tmp_path / "companion.toml").write_text("")
    done = subprocess.run(
        [sys.executable, "-c", script], cwd=tmp_path, capture_output=True, text=True, timeout=60, check=False
    )
    last = done.stderr.splitlines()[-1]
    assert re.fullmatch(f"companion {words[0]}: needs (numpy|cv2): {re.escape(to_install('rover'))}", last)
    assert (done.returncode, "Traceback" in done.stderr) == (2, False)


def test_a_demo_begins_nothing_without_what_it_draws_with(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(side_process, "find_spec", lambda name: None if name == "cv2" else name)
    assert main(["demo"]) == 2
    said = capsys.readouterr()
    assert said.err == f"companion demo: opencv-python-headless not installed: {to_install('sim')}\n"
    assert said.out == ""
