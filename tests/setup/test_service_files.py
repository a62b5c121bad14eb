"""The unit and its install script, without touching the system that runs the tests."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from tests.setup.conftest import Checkout

ROOT = Path(__file__).resolve().parents[2]
UNIT = ROOT / "systemd/companion.service"


def settings(unit: str) -> dict[str, str]:
    return dict(line.split("=", 1) for line in unit.splitlines() if "=" in line and not line.startswith("#"))


def test_systemd_finds_nothing_to_say_about_the_unit(tmp_path: Path) -> None:
    verify = shutil.which("systemd-analyze") or pytest.skip("systemd-analyze is not on this machine")
    unit = tmp_path / UNIT.name
    # The program need not be installed where the tests run.
    unit.write_text(UNIT.read_text().replace("/opt/anytraverse/bin/companion", sys.executable))
    done = subprocess.run(
        [verify, "verify", "--man=no", str(unit)], capture_output=True, text=True, timeout=60, check=False
    )
    about_the_unit = [line for line in done.stderr.splitlines() if UNIT.name in line]
    assert (done.returncode, about_the_unit) == (0, []), done.stderr


def test_the_unit_starts_what_the_script_installs_where_it_installs_it(
    checkout: Checkout, tmp_path: Path
) -> None:
    _, stage = installed(checkout, tmp_path)
    unit = settings((stage / "etc/systemd/system/companion.service").read_text())
    program, _, arguments = unit["ExecStart"].partition(" ")
    assert (stage / program[1:]).exists()
    assert (stage / arguments.rpartition(" ")[2][1:]).exists()
    assert unit["WorkingDirectory"] == f"/var/lib/{unit['StateDirectory']}"


def test_the_unit_gives_up_on_a_daemon_that_keeps_dying() -> None:
    unit = settings(UNIT.read_text())
    assert unit["Restart"] == "on-failure"
    limit, window, pause = (
        int(unit[name]) for name in ("StartLimitBurst", "StartLimitIntervalSec", "RestartSec")
    )
    assert limit * pause < window


def test_an_update_leaves_what_a_person_edited(checkout: Checkout, tmp_path: Path) -> None:
    _, stage = installed(checkout, tmp_path)
    edited = stage / "etc/anytraverse/companion.toml"
    edited.write_text("mine")
    (stage / "etc/systemd/system/companion.service").write_text("old")
    installed(checkout, tmp_path)
    assert edited.read_text() == "mine"
    assert (stage / "etc/systemd/system/companion.service").read_text() == UNIT.read_text()


def test_the_service_is_installed_with_what_a_rover_needs(checkout: Checkout, tmp_path: Path) -> None:
    installed(checkout, tmp_path)
    assert checkout.calls[-1].endswith(f"{checkout.root}[rover]")


def test_without_root_the_script_says_what_to_type(checkout: Checkout) -> None:
    checkout.python()
    bring_service_files(checkout)
    who = checkout.bin / "id"
    who.write_text("#!/usr/bin/env sh\necho 1000\n")
    who.chmod(0o755)
    done = checkout.run("sh", "systemd/install.sh", PYTHON="python3")
    assert done.returncode == 1
    assert done.stderr.startswith("install: this needs root: type: sudo sh systemd/install.sh")


def test_a_python_without_venv_is_refused_before_anything_is_installed(
    checkout: Checkout, tmp_path: Path
) -> None:
    checkout.python(ensurepip=False)
    bring_service_files(checkout)
    done = checkout.run("sh", "systemd/install.sh", PYTHON="python3", DESTDIR=str(tmp_path / "stage"))
    assert "sudo apt install python3-venv" in done.stderr
    assert not (tmp_path / "stage").exists()


def test_a_source_that_is_not_there_is_refused_before_anything_is_installed(
    checkout: Checkout, tmp_path: Path
) -> None:
    checkout.python()
    bring_service_files(checkout)
    stage = tmp_path / "stage"
    for source in ("nothing.whl", str(tmp_path / "nothing")):
        done = checkout.run("sh", "systemd/install.sh", source, PYTHON="python3", DESTDIR=str(stage))
        assert done.returncode == 1
        assert done.stderr == f"install: there is no {source}: name a checkout or a wheel\n"
    assert not stage.exists()


def bring_service_files(checkout: Checkout) -> None:
    for folder in ("config", "systemd"):
        shutil.copytree(ROOT / folder, checkout.root / folder, dirs_exist_ok=True)


def installed(checkout: Checkout, tmp_path: Path) -> tuple[subprocess.CompletedProcess[str], Path]:
    """Stages the service with a fake interpreter, as a packager would."""
    checkout.python()
    bring_service_files(checkout)
    stage = tmp_path / "stage"
    done = checkout.run("sh", "systemd/install.sh", PYTHON="python3", DESTDIR=os.fspath(stage))
    assert done.returncode == 0, done.stderr
    return done, stage
