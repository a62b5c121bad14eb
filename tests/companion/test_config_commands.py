"""The commands that write and change a configuration."""

from __future__ import annotations

import io
import json
import os
import signal
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from companion.cli import main
from companion.config import load_config
from companion.desk.check.here import read_status
from tests.waiting import wait_for

ROOT = Path(__file__).resolve().parents[2]
Told = pytest.CaptureFixture[str]


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "companion.toml"
    path.write_text('# mine\n[camera]\nrate = 10.0  # a second\n[vehicle]\nfile = ""\n')
    return path


def test_set_changes_settings_and_keeps_the_version_before(file: Path, capsys: Told) -> None:
    before = file.read_text()
    assert main(["config", "set", str(file), "--yes", "camera.rate=5", "words.dry grass=0.5"]) == 0
    assert file.read_text() == before.replace("10.0", "5") + '\n[words]\n"dry grass" = 0.5\n'
    assert file.with_name("companion.toml.1").read_text() == before
    assert "+rate = 5  # a second" in capsys.readouterr().out
    assert main(["config", "set", str(file), "--yes", "camera.rate=", "camera.source=v4l2:/dev/video0"]) == 0
    assert "rate" not in file.read_text()
    assert load_config(file).camera.source == "v4l2:/dev/video0"


@pytest.mark.parametrize(
    "words",
    [
        ["FILE", "SET", "--yes"],
        ["FILE", "--yes", "SET"],
        ["--yes", "FILE", "SET"],
        ["SET", "--yes"],
        ["--yes", "SET"],
        ["--config", "FILE", "SET", "--yes"],
        ["--config", "FILE", "--yes", "SET"],
        ["--yes", "--config", "FILE", "SET"],
        ["SET", "--config", "FILE", "--yes"],
        ["SET", "--yes", "--config", "FILE"],
    ],
)
def test_set_takes_the_file_alone_by_its_option_or_that_of_the_folder(
    file: Path, monkeypatch: pytest.MonkeyPatch, words: list[str]
) -> None:
    if "FILE" not in words:
        monkeypatch.chdir(file.parent)
    named = {"FILE": [str(file)], "SET": ["camera.rate=5", "words.dry grass=0.5"]}
    assert main(["config", "set", *(one for word in words for one in named.get(word, [word]))]) == 0
    assert load_config(file).camera.rate == 5.0
    assert '"dry grass" = 0.5' in file.read_text()


def test_a_setting_that_names_a_file_is_not_taken_for_the_configuration(
    file: Path, monkeypatch: pytest.MonkeyPatch, capsys: Told
) -> None:
    monkeypatch.chdir(file.parent)
    assert main(["config", "set", "--yes", f"vehicle.file={file}/no.toml"]) == 2
    assert "companion config: by companion.toml\n" in capsys.readouterr().err


@pytest.mark.parametrize("words", [["FILE", "camera.rate=5", "--config"], ["--config"]])
def test_set_refuses_two_files_and_nothing_to_change(file: Path, capsys: Told, words: list[str]) -> None:
    before, other = file.read_text(), file.with_name("other.toml")
    other.write_text(before)
    typed = [str(file) if word == "FILE" else word for word in words]
    assert main(["config", "set", *typed, str(other), "--yes"]) == 2
    assert ("not both" if "FILE" in words else "say what to change") in capsys.readouterr().err
    assert file.read_text() == other.read_text() == before


@pytest.mark.parametrize(("typed", "written"), [("y\n", True), ("n\n", False), ("\n", False), ("", False)])
def test_set_asks_and_writes_only_after_a_yes(
    file: Path, monkeypatch: pytest.MonkeyPatch, typed: str, written: bool
) -> None:
    before = file.read_text()
    monkeypatch.setattr("sys.stdin", io.StringIO(typed))
    assert main(["config", "set", str(file), "camera.rate=5"]) == (0 if written else 1)
    assert (file.read_text() != before) is written


@pytest.mark.parametrize(
    ("setting", "told"),
    [
        ("camera.rate=500", "camera.rate = 500: give a number from 0.5 to 60"),
        ("camera.rat=5", 'camera.rat: is not known; did you mean "rate"?'),
        ("camera.rate", "write KEY=VALUE"),
        ("camera.source=/dev/video9", 'did you mean "v4l2:/dev/video9"?'),
    ],
)
def test_set_refuses_what_is_wrong_and_says_why(file: Path, capsys: Told, setting: str, told: str) -> None:
    before = file.read_text()
    assert main(["config", "set", str(file), "--yes", setting]) == 2
    assert told in capsys.readouterr().err
    assert file.read_text() == before


def test_set_says_where_nothing_changes(file: Path, capsys: Told) -> None:
    assert main(["config", "set", str(file), "camera.rate=10.0"]) == 0
    assert "says that already" in capsys.readouterr().out


def test_check_notes_a_camera_that_is_not_there(file: Path, capsys: Told) -> None:
    main(["config", "set", str(file), "--yes", "camera.source=v4l2:/dev/video97"])
    assert main(["config", "check", str(file)]) == 0
    assert "note: [camera] source: there is no /dev/video97 now" in capsys.readouterr().err


def test_init_simulated_writes_one_that_passes_the_check_and_says_what_to_type(
    tmp_path: Path, capsys: Told
) -> None:
    folder = tmp_path / "new"
    assert main(["init", "--simulated", str(folder)]) == 0
    told = capsys.readouterr().out
    assert f"companion run --config {folder}/companion.toml" in told
    assert main(["config", "check", str(folder / "companion.toml")]) == 0
    config = load_config(folder / "companion.toml")
    assert f"companion.sim.field --port {config.link.url.rpartition(':')[2]} " in told
    assert config.call.holds
    assert "# Where frames come from:" in (folder / "companion.toml").read_text()
    assert main(["init", "--simulated", str(folder)]) == 2
    assert "is there already" in capsys.readouterr().err


@pytest.mark.slow
def test_a_field_on_a_port_that_is_taken_says_so() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as taken:
        taken.bind(("127.0.0.1", 0))
        port = str(taken.getsockname()[1])
        done = subprocess.run(
            [sys.executable, "-m", "companion.sim.field", "--port", port, "--no-script"],
            capture_output=True,
            text=True,
            timeout=60,
            check=False,
        )
    assert done.returncode == 2
    assert done.stderr == f"port {port} or the two after it: Address already in use: give another --port\n"


@pytest.mark.slow
def test_a_simulated_configuration_runs_with_the_field(tmp_path: Path) -> None:
    file = tmp_path / "companion.toml"
    main(["init", "--simulated", str(tmp_path)])
    command = [sys.executable, "-m", "companion.sim.field", "--autostart", "--no-script"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, cwd=ROOT) as field:
        try:
            assert field.stdout is not None
            at = json.loads(field.stdout.readline())
            camera, link = f"camera.source=field:{at['frames']}", f"link.url={at['companion']}"
            assert main(["config", "set", str(file), "--yes", camera, link, "web.listen="]) == 0
            run = [sys.executable, "-m", "companion", "run", "--config", str(file)]
            with subprocess.Popen(run, cwd=ROOT, env={**os.environ, "PYTHONPATH": str(ROOT)}) as companion:
                try:
                    wait_for(lambda: _sees_and_hears(tmp_path / "state"), 60.0)
                finally:
                    companion.send_signal(signal.SIGTERM)
            assert companion.returncode == 0
        finally:
            field.kill()


def _sees_and_hears(state: Path) -> bool:
    told = read_status(state)[1]
    return bool(told.get("frames") and told["link"]["autopilot"])
