"""The set-up script: what it says when something is missing, and when it does nothing at all."""

from __future__ import annotations

import shutil
import signal
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from tests.setup.conftest import Checkout


def test_no_python_at_all_is_one_line_with_what_to_type(checkout: Checkout) -> None:
    assert checkout.refusal() == "set-up: no Python found: type: sudo apt install python3 python3-venv"


def test_a_python_that_is_too_old_is_named_with_its_version(checkout: Checkout) -> None:
    checkout.python(version=[3, 9, 2])
    line = checkout.refusal(GOAL="test")
    assert "python3 is 3.9.2, and Python 3.10 or newer is needed" in line
    assert "make test PYTHON=" in line


def test_a_newer_python_beside_an_old_python3_is_taken(checkout: Checkout) -> None:
    checkout.python(version=[3, 9, 2])
    checkout.python("python3.12", version=[3, 12, 1])
    done = checkout.set_up()
    assert done.returncode == 0, done.stderr
    assert "Python 3.12.1" in done.stdout


def test_a_missing_ensurepip_names_the_package_that_has_it(checkout: Checkout) -> None:
    checkout.python(ensurepip=False)
    assert checkout.refusal().endswith("type: sudo apt install python3-venv")


def test_a_missing_ensurepip_of_a_chosen_python_names_that_versions_package(checkout: Checkout) -> None:
    checkout.python("python3.12", version=[3, 12, 3], ensurepip=False)
    assert checkout.refusal(PYTHON="python3.12").endswith("type: sudo apt install python3.12-venv")


def test_a_32_bit_system_is_refused_before_anything_is_made(checkout: Checkout) -> None:
    checkout.python(bits=32)
    assert "32-bit" in checkout.refusal()
    assert not checkout.venv.exists()


def test_a_chosen_python_that_does_not_run_is_refused_by_name(checkout: Checkout) -> None:
    checkout.python()
    assert "PYTHON=/no/such/python does not run" in checkout.refusal(PYTHON="/no/such/python")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("pip_says", "expected"),
    [
        ("NewConnectionError('Temporary failure in name resolution')", "check the network"),
        ("OSError: [Errno 28] No space left on device", "the disk is full"),
        (
            "ERROR: No matching distribution found for numpy",
            "(ERROR: No matching distribution found for numpy)",
        ),
        ("", "(it gave no reason)"),
    ],
)
def test_a_failure_of_pip_is_one_line_with_the_log_and_no_stamp(
    checkout: Checkout, pip_says: str, expected: str
) -> None:
    checkout.python(pip_says=pip_says, pip_exits=1)
    line = checkout.refusal()
    assert expected in line
    log = Path(line.rpartition("The log: ")[2])
    assert pip_says in log.read_text()
    assert checkout.stamps == set()


def test_a_second_set_up_says_nothing_and_calls_neither_venv_nor_pip(checkout: Checkout) -> None:
    checkout.python()
    assert checkout.set_up("dev").returncode == 0
    before = checkout.calls
    done = checkout.set_up("dev")
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    assert checkout.calls == before


def test_a_developers_set_up_is_enough_for_the_demo(checkout: Checkout) -> None:
    checkout.python()
    checkout.set_up("dev")
    before = checkout.calls
    assert checkout.set_up("sim").returncode == 0
    assert checkout.calls == before


def test_the_demos_set_up_is_kept_and_added_to_for_the_tests(checkout: Checkout) -> None:
    checkout.python()
    checkout.set_up("sim")
    checkout.set_up("dev")
    assert [call.split()[1] for call in checkout.calls] == ["venv", "pip", "pip"]
    assert checkout.calls[-1].endswith(".[dev]")


def test_the_benchs_set_up_adds_to_the_tests_and_neither_stands_for_the_other(checkout: Checkout) -> None:
    checkout.python()
    checkout.set_up("dev")
    checkout.set_up("export")
    assert [call.rpartition(" ")[2] for call in checkout.calls[1:]] == [".[dev]", ".[export]"]
    assert checkout.stamps == {".ready-sim", ".ready-dev", ".ready-export"}


def test_a_changed_project_file_is_installed_again(checkout: Checkout) -> None:
    checkout.python()
    checkout.set_up()
    with (checkout.root / "pyproject.toml").open("a") as project:
        project.write("# changed\n")
    checkout.set_up()
    assert [call.split()[1] for call in checkout.calls] == ["venv", "pip", "pip"]


def test_a_checkout_that_was_moved_gets_a_new_environment(checkout: Checkout) -> None:
    checkout.python()
    checkout.set_up()
    moved = checkout.root.with_name("moved")
    shutil.copytree(checkout.root, moved)
    checkout.root = moved
    done = checkout.set_up()
    assert "making .venv" in done.stdout
    assert str(moved / ".venv") in (moved / ".venv/.ready-sim").read_text()


def test_an_environment_whose_interpreter_is_gone_is_made_again(checkout: Checkout) -> None:
    checkout.python()
    checkout.set_up()
    (checkout.venv / "bin/python").unlink()
    assert "making .venv" in checkout.set_up().stdout


def test_an_upgrade_of_the_systems_python_makes_it_again(checkout: Checkout) -> None:
    checkout.python(version=[3, 11, 2])
    checkout.set_up()
    checkout.python(version=[3, 13, 5])
    assert "making .venv with Python 3.13.5" in checkout.set_up().stdout


@pytest.mark.slow
def test_another_python_that_was_asked_for_makes_it_again_and_the_same_does_not(checkout: Checkout) -> None:
    checkout.python()
    checkout.python("python3.12", version=[3, 12, 1])
    checkout.set_up()
    assert "making .venv with Python 3.12.1" in checkout.set_up(PYTHON="python3.12").stdout
    assert checkout.set_up(PYTHON="python3.12").stdout == ""
    assert checkout.set_up().stdout == ""


def test_an_environment_made_by_hand_is_used_and_not_removed(checkout: Checkout) -> None:
    fake = checkout.python()
    (checkout.venv / "bin").mkdir(parents=True)
    shutil.copy(fake, checkout.venv / "bin/python")
    assert checkout.set_up().returncode == 0
    assert [call.split()[1] for call in checkout.calls] == ["pip"]


def test_an_activated_environment_is_not_asked_to_replace_itself(checkout: Checkout) -> None:
    checkout.python()
    checkout.set_up()
    shutil.copy(checkout.venv / "bin/python", checkout.venv / "bin/python3")
    (checkout.venv / ".unfinished").touch()
    done = checkout.set_up(PATH=f"{checkout.venv}/bin:{checkout.bin}")
    assert done.returncode == 0, done.stderr
    assert "making .venv" in done.stdout


def test_without_network_the_tests_set_up_leaves_the_demos_usable(checkout: Checkout) -> None:
    checkout.python()
    checkout.set_up("sim")
    checkout.python(pip_says="NewConnectionError", pip_exits=1)
    checkout.refusal("dev")
    assert checkout.stamps == {".ready-sim"}
    assert checkout.set_up("sim").stdout == ""


def test_a_pip_that_fails_while_installing_begins_again_from_nothing(checkout: Checkout) -> None:
    checkout.python()
    checkout.set_up("sim")
    checkout.python(pip_says="Installing collected packages: numpy", pip_exits=1)
    checkout.refusal("dev")
    checkout.python()
    assert "making .venv" in checkout.set_up("sim").stdout


def test_a_set_up_that_was_killed_begins_again_from_nothing(checkout: Checkout) -> None:
    checkout.python()
    checkout.set_up("sim")
    checkout.python(pip_kills_the_script=True)
    assert checkout.set_up("dev").returncode == -signal.SIGKILL
    assert checkout.stamps == {".ready-sim"}
    checkout.python()
    assert "making .venv" in checkout.set_up("sim").stdout
