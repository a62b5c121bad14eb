"""The unit and its install script, without touching the system that runs the tests."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

from companion.system.service_manager import LONGEST_PAUSE

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


def test_the_unit_never_gives_up_and_waits_a_minute_at_most() -> None:
    unit = settings(UNIT.read_text())
    assert (unit["Restart"], unit["StartLimitIntervalSec"]) == ("always", "0")
    assert int(unit["RestartSec"]) + LONGEST_PAUSE == 60.0
    assert "RestartPreventExitStatus" not in unit


def test_the_watchdog_ends_a_hanging_daemon_within_the_time_that_a_restart_may_take() -> None:
    unit = settings(UNIT.read_text())
    assert unit["Type"] == "notify"
    assert int(unit["WatchdogSec"]) + int(unit["RestartSec"]) < 12


def test_the_unit_is_hardened_and_leaves_the_devices_of_a_rover_usable(tmp_path: Path) -> None:
    analyze = shutil.which("systemd-analyze") or pytest.skip("systemd-analyze is not on this machine")
    unit = tmp_path / UNIT.name
    unit.write_text(UNIT.read_text())
    done = subprocess.run(
        [analyze, "security", "--offline=true", "--no-pager", str(unit)],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    if "unrecognized option" in done.stderr:
        pytest.skip("this systemd-analyze reads no unit that is not installed")
    exposure = re.search(r"exposure level for companion.service: ([0-9.]+)", done.stdout)
    assert exposure is not None, done.stderr
    assert float(exposure[1]) <= 1.7
    devices = {
        line.split("=")[1].split()[0] for line in unit.read_text().splitlines() if "DeviceAllow=" in line
    }
    assert {"char-video4linux", "char-ttyACM", "char-ttyUSB", "char-ttyAMA", "char-usb_device"} <= devices


def test_no_hardening_breaks_what_the_daemon_needs() -> None:
    text = UNIT.read_text()
    assert "SystemCallErrorNumber=EPERM" in text
    for broken in ("ProcSubset=", "~@resources", "PrivateDevices=", "PrivateUsers=yes", "PrivateNetwork="):
        assert broken not in text


def test_every_jump_of_the_device_rules_has_its_place() -> None:
    text = (ROOT / "systemd/70-anytraverse.rules").read_text()
    assert set(re.findall(r'GOTO="(\w+)"', text)) == set(re.findall(r'LABEL="(\w+)"', text))


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


def test_a_full_disk_is_refused_before_anything_is_installed(checkout: Checkout, tmp_path: Path) -> None:
    checkout.python()
    bring_service_files(checkout)
    (checkout.bin / "df").unlink()
    fake = checkout.bin / "df"
    fake.write_text("#!/usr/bin/env sh\necho Filesystem\necho /dev/root 30000000 29700000 300000 99% /\n")
    fake.chmod(0o755)
    done = checkout.run("sh", "systemd/install.sh", PYTHON="python3", DESTDIR=str(tmp_path / "stage"))
    assert done.returncode == 1
    assert "has 292 MB free" in done.stderr
    assert not (tmp_path / "stage").exists()


def test_a_failed_download_leaves_no_half_program(checkout: Checkout, tmp_path: Path) -> None:
    checkout.python(pip_exits=1)
    bring_service_files(checkout)
    done = checkout.run("sh", "systemd/install.sh", PYTHON="python3", DESTDIR=str(tmp_path / "stage"))
    assert done.returncode == 1
    assert "check the network and type it again" in done.stderr
    assert list((tmp_path / "stage/opt").iterdir()) == []
    assert not list((tmp_path / "stage/etc/systemd/system").iterdir())


def test_programs_of_a_package_name_the_folder_they_will_be_in(checkout: Checkout, tmp_path: Path) -> None:
    stage = tmp_path / "stage"
    script = f"#!{stage}/opt/anytraverse/bin/python\n"
    installed(
        checkout,
        tmp_path,
        makes={"bin/written": script, "pyvenv.cfg": f"command = {stage}/opt/anytraverse\n"},
    )
    program = stage / "opt/anytraverse"
    assert (program / "bin/written").read_text() == "#!/opt/anytraverse/bin/python\n"
    assert (program / "pyvenv.cfg").read_text() == "command = /opt/anytraverse\n"


def test_a_packagers_folder_never_removes_what_is_installed_on_this_computer(checkout: Checkout) -> None:
    bring_service_files(checkout)
    done = checkout.run("sh", "systemd/install.sh", "--uninstall", "--purge", DESTDIR="/nowhere")
    assert done.returncode == 1
    assert "leave DESTDIR out" in done.stderr


def test_an_unknown_option_is_refused_with_those_that_exist(checkout: Checkout) -> None:
    bring_service_files(checkout)
    done = checkout.run("sh", "systemd/install.sh", "--remove")
    assert done.returncode == 1
    assert "--uninstall --purge" in done.stderr


def bring_service_files(checkout: Checkout) -> None:
    for folder in ("config", "systemd"):
        shutil.copytree(ROOT / folder, checkout.root / folder, dirs_exist_ok=True)


def installed(
    checkout: Checkout, tmp_path: Path, makes: dict[str, str] | None = None
) -> tuple[subprocess.CompletedProcess[str], Path]:
    """Stages the service with a fake interpreter, as a packager would. makes: files of its environments."""
    checkout.python(makes=makes or {})
    bring_service_files(checkout)
    stage = tmp_path / "stage"
    done = checkout.run("sh", "systemd/install.sh", PYTHON="python3", DESTDIR=os.fspath(stage))
    assert done.returncode == 0, done.stderr
    return done, stage
