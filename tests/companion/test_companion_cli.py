"""The command line: what it writes, what it refuses, and with which exit code."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

import pytest

from companion.cli import main
from companion.config import load_config


def test_init_writes_files_that_check_passes(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert main(["init", str(tmp_path / "new")]) == 0
    assert main(["config", "check", str(tmp_path / "new/companion.toml")]) == 0
    printed = capsys.readouterr().out
    assert "[roi]" in printed
    assert "bush = -1.0" in printed


def test_init_never_overwrites(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "companion.toml").write_text("# mine\n")
    assert main(["init", str(tmp_path)]) == 0
    assert (tmp_path / "companion.toml").read_text() == "# mine\n"
    assert (tmp_path / "vehicles/rover.toml").is_file()
    printed = capsys.readouterr().out
    assert "left as it is" in printed
    assert (
        "records pictures, positions and the log, 1000 MB as shipped: [recording] size = 0 ends that"
        in printed
    )


def test_init_where_a_file_stands_says_so(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (tmp_path / "file").write_text("")
    assert main(["init", str(tmp_path / "file")]) == 2
    told = capsys.readouterr().err
    assert told.startswith("companion init: ")
    assert "name a folder that you may write" in told


def test_what_check_prints_is_a_configuration(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    main(["init", str(tmp_path)])
    capsys.readouterr()
    main(["config", "check", str(tmp_path / "companion.toml")])
    (tmp_path / "again.toml").write_text(capsys.readouterr().out)
    assert load_config(tmp_path / "again.toml").words == load_config(tmp_path / "companion.toml").words


@pytest.mark.parametrize("command", [["run"], ["run", "--config"], ["config", "check"]])
def test_a_wrong_configuration_ends_with_2_and_one_line(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], command: list[str]
) -> None:
    path = tmp_path / "companion.toml"
    path.write_text('[vehicle]\nfile = ""\n[camera]\nrate = 0\n')
    assert main([*command, str(path)]) == 2
    told = capsys.readouterr().err
    assert told == f"companion {command[0]}: {path}:4: camera.rate = 0: give a number from 0.5 to 60\n"


def test_several_problems_take_a_line_each(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = tmp_path / "companion.toml"
    path.write_text('[vehicle]\nfile = ""\n[camera]\nrate = 0\nloop = 1\n')
    assert main(["config", "check", str(path)]) == 2
    assert len(capsys.readouterr().err.splitlines()) == 3


def test_a_configuration_that_is_not_there_says_how_to_get_one(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["config", "check", str(tmp_path / "none.toml")]) == 2
    assert "companion init" in capsys.readouterr().err


@pytest.mark.parametrize("arguments", [[], ["fly"], ["config"], ["run", "--speed", "3"]])
def test_what_is_no_command_ends_with_2(arguments: list[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main(arguments)
    assert ended.value.code == 2


def test_the_command_line_starts_without_anything_heavy() -> None:
    script = "import sys, companion.cli; print({'cv2', 'numpy', 'pymavlink'} & set(sys.modules))"
    result = subprocess.run(
        [sys.executable, "-c", script], capture_output=True, text=True, check=True, timeout=60
    )
    assert result.stdout.strip() == "set()"


def test_check_refuses_a_word_that_the_perceiver_does_not_know(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "companion.toml"
    path.write_text('[vehicle]\nfile = ""\n[words]\nunicorn = 1\n', encoding="utf-8")
    assert main(["config", "check", str(path)]) == 2
    assert f'{path}:4: words.unicorn = 1: "unicorn" is not a word it knows' in capsys.readouterr().err


def test_such_a_word_is_shown_where_it_stands_in_the_vehicles_file(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, vehicle = tmp_path / "companion.toml", tmp_path / "rover.toml"
    path.write_text('[vehicle]\nfile = "rover.toml"\n', encoding="utf-8")
    vehicle.write_text("[words]\ngrass = 1\ngrsas = 0.5\n", encoding="utf-8")
    assert main(["config", "check", str(path)]) == 2
    assert f'{vehicle}:3: words.grsas = 0.5: "grsas" is not a word it knows: grass' in capsys.readouterr().err


def test_check_refuses_a_signing_key_that_others_may_read(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path, key = tmp_path / "companion.toml", tmp_path / "signing.key"
    path.write_text('[vehicle]\nfile = ""\n[words]\ngrass = 1\n[link]\nsigning_key = "signing.key"\n')
    assert main(["config", "check", str(path)]) == 2
    assert f"there is no signing key {key}" in capsys.readouterr().err
    key.write_bytes(bytes(range(32)))
    key.chmod(0o644)
    assert main(["config", "check", str(path)]) == 2
    assert f"chmod 600 {key}" in capsys.readouterr().err
    key.chmod(0o600)
    assert main(["config", "check", str(path)]) == 0


@pytest.mark.parametrize(
    ("module", "heavy"),
    [
        ("companion.cli", ("numpy", "msgspec", "companion.config", "companion.daemon")),
        ("companion.desk.check.running", ("cv2", "onnxruntime", "companion.daemon")),
    ],
)
def test_help_and_status_import_nothing_that_lets_a_person_wait(module: str, heavy: tuple[str, ...]) -> None:
    asked = f"import sys, {module}; print(*sys.modules)"
    done = subprocess.run([sys.executable, "-c", asked], capture_output=True, text=True, check=True)
    assert not set(done.stdout.split()) & set(heavy)
