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

from companion.config.request import ANSWERS, REQUEST
from companion.config.root_helper import REQUESTS
from companion.system.service_manager import LONGEST_PAUSE

if TYPE_CHECKING:
    from tests.setup.conftest import Checkout

ROOT = Path(__file__).resolve().parents[2]
UNIT = ROOT / "systemd/companion.service"


def settings(unit: str) -> dict[str, str]:
    return dict(line.split("=", 1) for line in unit.splitlines() if "=" in line and not line.startswith("#"))


def services() -> list[Path]:
    """The unit of the companion, and those of what systemd starts beside it."""
    return sorted((ROOT / "systemd").glob("*.service"))


def laid_out(folder: Path) -> None:
    """Lay out all units as the script does. The programs need not be installed where the tests run."""
    for unit in (ROOT / "systemd").iterdir():
        if unit.suffix in (".service", ".socket", ".path", ".slice"):
            text = re.sub(r"/opt/anytraverse/bin/\w+", sys.executable, unit.read_text())
            (folder / unit.name).write_text(text)
    for unit in services():
        if unit.name.startswith("companion"):
            drop_ins = folder / f"{unit.name}.d"
            drop_ins.mkdir()
            shutil.copy(ROOT / "systemd/hardening.conf", drop_ins / "10-hardening.conf")


def test_systemd_finds_nothing_to_say_about_the_units(tmp_path: Path) -> None:
    verify = shutil.which("systemd-analyze") or pytest.skip("systemd-analyze is not on this machine")
    laid_out(tmp_path)
    units = [str(one) for one in tmp_path.iterdir() if one.is_file()]
    done = subprocess.run(
        [verify, "verify", "--man=no", *units],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
        env={**os.environ, "SYSTEMD_UNIT_PATH": f"{tmp_path}:"},
    )
    said = [line for line in done.stderr.splitlines() if "companion" in line or "anytraverse" in line]
    assert (done.returncode, said) == (0, []), done.stderr


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


@pytest.mark.parametrize("unit", services(), ids=lambda unit: str(unit.stem))
def test_each_unit_is_hardened(unit: Path, tmp_path: Path) -> None:
    analyze = shutil.which("systemd-analyze") or pytest.skip("systemd-analyze is not on this machine")
    whole = tmp_path / unit.name
    drop_in = "" if unit.stem.startswith("anytraverse") else (ROOT / "systemd/hardening.conf").read_text()
    whole.write_text(unit.read_text() + drop_in)
    done = subprocess.run(
        [analyze, "security", "--offline=true", "--no-pager", str(whole)],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    if "unrecognized option" in done.stderr:
        pytest.skip("this systemd-analyze reads no unit that is not installed")
    exposure = re.search(r"exposure level for \S+: ([0-9.]+)", done.stdout)
    assert exposure is not None, done.stderr
    assert float(exposure[1]) <= 1.7


def devices(name: str) -> set[str]:
    text = (ROOT / "systemd" / name).read_text()
    return {line.split("=")[1].split()[0] for line in text.splitlines() if line.startswith("DeviceAllow=")}


def test_the_supervisor_has_serial_ports_and_the_vision_process_cameras() -> None:
    serial = {"char-ttyACM", "char-ttyUSB", "char-ttyAMA", "char-ttyS", "char-ttyTHS"}
    assert devices("companion.service") == serial
    cameras = {"char-video4linux", "char-media", "char-dma_heap", "char-usb_device"}
    assert devices("companion-vision@.service") == devices("companion-network-vision@.service") == cameras
    for one in ("page", "live", "video", "recorder"):
        assert devices(f"companion-{one}@.service") == set()


def test_each_process_has_a_user_of_its_own_and_its_socket_is_the_supervisor_s_alone() -> None:
    users = set()
    for unit in (ROOT / "systemd").glob("companion-*@.service"):
        service = settings(unit.read_text())
        socket = settings(unit.with_name(unit.name.replace("@.service", ".socket")).read_text())
        assert (socket["SocketUser"], socket["SocketMode"], socket["Accept"]) == (
            "anytraverse",
            "0600",
            "yes",
        )
        assert (service["DynamicUser"], service["InaccessiblePaths"][:16]) == ("yes", "/etc/anytraverse")
        assert "-I" in service["ExecStart"].split(), "its working directory may hold modules of others"
        users.add(service["User"])
        wanted = UNIT.read_text()
        assert unit.name.replace("@.service", ".socket") in wanted
        kind = unit.name.removeprefix("companion-").removesuffix("@.service")
        assert f"anytraverse-kill@{kind}.path" in wanted
        assert f" companion-{kind}@*.service" in settings(wanted)["ExecStopPost"]
    assert users == {f"anytraverse-{name}" for name in ("vision", "page", "live", "video", "recorder")}


def test_a_kill_that_failed_leaves_its_request_and_is_tried_again() -> None:
    unit = settings((ROOT / "systemd/anytraverse-kill@.service").read_text())
    assert unit["ExecStart"].startswith("/usr/bin/systemctl kill "), "its failure counts"
    assert unit["ExecStartPost"] == "/usr/bin/rm -f /run/anytraverse/kill-%i", "only after a success"
    assert (unit["Restart"], unit["RestartSec"], unit["StartLimitIntervalSec"]) == ("on-failure", "1", "0")


def test_the_helper_that_changes_settings_waits_where_the_supervisor_lays_its_requests() -> None:
    path = settings((ROOT / "systemd/anytraverse-config.path").read_text())
    assert path["PathExists"] == str(REQUESTS / REQUEST)
    unit = settings((ROOT / "systemd/anytraverse-config.service").read_text())
    assert unit["RuntimeDirectory"] == ANSWERS.name
    assert ANSWERS.parent == REQUESTS.parent
    assert unit["ReadWritePaths"] == "/etc/anytraverse /run/anytraverse", "and nothing else"
    assert "-I" in unit["ExecStart"].split()
    assert f"rm -rf {REQUESTS / REQUEST}" in unit["ExecStopPost"], "a helper that fails is not started again"
    assert "anytraverse-config.path" in UNIT.read_text()


def test_no_hardening_breaks_what_the_daemon_needs() -> None:
    hardening = (ROOT / "systemd/hardening.conf").read_text()
    assert "SystemCallErrorNumber=EPERM" in hardening
    for broken in ("ProcSubset=", "~@resources", "PrivateDevices=", "PrivateUsers=yes", "PrivateNetwork="):
        assert broken not in hardening + UNIT.read_text()


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
    hardening = (ROOT / "systemd/hardening.conf").read_text()
    for unit in services():
        drop_in = stage / f"etc/systemd/system/{unit.name}.d/10-hardening.conf"
        assert drop_in.exists() == unit.name.startswith("companion")
        assert not drop_in.exists() or drop_in.read_text() == hardening


def test_the_service_is_installed_with_what_a_rover_needs(checkout: Checkout, tmp_path: Path) -> None:
    installed(checkout, tmp_path)
    assert any(call.endswith(f"{checkout.root}[rover]") for call in checkout.calls)


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


PAGES = ("man/man1/companion.1", "bash-completion/completions/companion", "zsh/site-functions/_companion")


def test_programs_pages_and_completion_are_where_a_shell_looks_for_them(
    checkout: Checkout, tmp_path: Path
) -> None:
    makes = {f"share/{page}": "" for page in PAGES}
    _, stage = installed(checkout, tmp_path, makes=makes)
    for program in ("companion", "anytraverse", "anytraverse-console", "anytraverse-operator"):
        link = stage / "usr/local/bin" / program
        assert os.readlink(link) == f"/opt/anytraverse/bin/{program}"
    for page in PAGES:
        assert os.readlink(stage / "usr/local/share" / page) == f"/opt/anytraverse/share/{page}"
    assert not (stage / "opt/anytraverse/pages").exists(), "what wrote them is not kept"
    done, _ = installed(checkout, tmp_path, makes=makes)
    assert "is not of this installation" not in done.stdout


def test_a_program_of_somebody_else_stays_as_it_is(checkout: Checkout, tmp_path: Path) -> None:
    theirs = tmp_path / "stage/usr/local/bin/companion"
    theirs.parent.mkdir(parents=True)
    theirs.write_text("theirs")
    other = theirs.with_name("anytraverse")
    other.symlink_to("/home/somebody/anytraverse")
    done, _ = installed(checkout, tmp_path)
    assert theirs.read_text() == "theirs"
    assert os.readlink(other) == "/home/somebody/anytraverse"
    assert f"{theirs} is not of this installation" in done.stdout
    assert "type /opt/anytraverse/bin/companion" in done.stdout


def test_what_the_program_never_imports_is_removed(checkout: Checkout, tmp_path: Path) -> None:
    site = "lib/python3.11/site-packages"
    kept = {f"{site}/pymavlink/dialects/v20/{name}.py" for name in ("__init__", "common", "development")}
    gone = {
        f"{site}/pymavlink/dialects/v10/common.py",
        f"{site}/pymavlink/dialects/v20/all.py",
        f"{site}/numpy/lib/tests/test_io.py",
    }
    _, stage = installed(checkout, tmp_path, makes=dict.fromkeys(kept | gone, ""))
    program = stage / "opt/anytraverse"
    assert {name for name in kept | gone if (program / name).exists()} == kept


@pytest.mark.slow
def test_the_program_imports_no_dialect_that_is_removed() -> None:
    asked = "import sys, companion.run, companion.desk.check.table, companion.sim.field.__main__\n"
    asked += "import companion.desk.check.measure, gcs_plugin.console.main, gcs_plugin.terminal.main\n"
    asked += "print([name for name in sys.modules if name.startswith('pymavlink.dialects.v')])"
    done = subprocess.run([sys.executable, "-c", asked], capture_output=True, text=True, check=True)
    kept = {"pymavlink.dialects.v20", *(f"pymavlink.dialects.v20.{one}" for one in ("common", "development"))}
    assert set(re.findall(r"[\w.]+", done.stdout)) == kept


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


@pytest.mark.parametrize("file", ["systemd/install.sh", ".ci/deb.sh"])
def test_the_next_step_after_an_installation_is_the_set_up_and_then_the_start(file: str) -> None:
    text = (ROOT / file).read_text()
    told = re.search(
        r"sudo companion setup +\(or: sudoedit (?:\$config|/etc/anytraverse)/companion\.toml\)"
        r".*?sudo systemctl enable --now companion",
        text,
        re.DOTALL,
    )
    assert told is not None
    assert told[0].count("\n") <= 1
