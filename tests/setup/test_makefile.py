"""What the Makefile hands on, and the gate that runs it."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path
from typing import TYPE_CHECKING

import pytest

if TYPE_CHECKING:
    from tests.setup.conftest import Checkout

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ([], "demo"),
        (["AUTO=1", "SEED=7"], "demo --auto --seed 7"),
        (["AUTO=0"], "demo"),
        (["OUT=a folder; false"], "demo --out a folder; false"),
    ],
)
def test_make_demo_hands_its_options_to_the_demo(checkout: Checkout, words: list[str], expected: str) -> None:
    checkout.python()
    done = checkout.run("make", "demo", *words)
    assert done.returncode == 0, done.stderr
    assert checkout.calls[-1] == expected


@pytest.mark.parametrize(
    ("words", "expected"), [([], ""), (["SEED=7", "OUT=a folder"], " --seed 7 --out a folder")]
)
def test_make_console_hands_its_options_to_the_demo(
    checkout: Checkout, words: list[str], expected: str
) -> None:
    checkout.python()
    done = checkout.run("make", "console", *words)
    assert done.returncode == 0, done.stderr
    assert checkout.calls[-1] == f"demo --console{expected}"


def test_make_demo_installs_only_what_a_rover_needs(checkout: Checkout) -> None:
    checkout.python()
    checkout.run("make", "demo")
    (install,) = (call for call in checkout.calls if call.startswith("-m pip"))
    assert install.endswith("-e .[sim]")


def test_make_test_hands_its_arguments_to_pytest(checkout: Checkout) -> None:
    checkout.python()
    done = checkout.run("make", "test", "ARGS=-k wheel")
    assert done.returncode == 0, done.stderr
    options = r"-m pytest -n \d+ --dist=loadfile --no-loadscope-reorder"
    assert re.fullmatch(rf"{options} -m not slow -k wheel", checkout.calls[-1])
    checkout.run("make", "test-slow", "ARGS=-k wheel")
    assert re.fullmatch(rf"{options} -m slow -k wheel", checkout.calls[-1])


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        ([], "-m bench.clipseg"),
        (["ARGS=--quick", "OUT=a folder; false"], "-m bench.clipseg --quick --out a folder; false"),
    ],
)
def test_the_bench_of_networks_gets_its_own_set_up_and_options(
    checkout: Checkout, words: list[str], expected: str
) -> None:
    checkout.python()
    done = checkout.run("make", "bench-clipseg", *words)
    assert done.returncode == 0, done.stderr
    (install,) = (call for call in checkout.calls if call.startswith("-m pip"))
    assert install.endswith("-e .[export]")
    assert checkout.calls[-1] == expected


@pytest.mark.parametrize(("bench", "arguments"), [("stopping", "--runs 2"), ("link", "lossy --calls 20")])
def test_other_benches_run_with_the_developer_s_set_up(
    checkout: Checkout, bench: str, arguments: str
) -> None:
    checkout.python()
    done = checkout.run("make", f"bench-{bench}", f"ARGS={arguments}")
    assert done.returncode == 0, done.stderr
    (install,) = (call for call in checkout.calls if call.startswith("-m pip"))
    assert install.endswith("-e .[dev]")
    assert checkout.calls[-1] == f"-m bench.{bench} {arguments}"


def test_real_ground_stations_get_an_environment_of_their_own(checkout: Checkout) -> None:
    checkout.python()
    done = checkout.run("make", "interop", "ARGS=-k ftp")
    assert done.returncode == 0, done.stderr
    made = [call.split()[-1].rpartition("/")[2] for call in checkout.calls[:-1]]
    assert made == [".venv", ".[dev]", ".venv-interop", ".[interop]"]
    assert checkout.calls[-1] == "-m pytest tests/interop -k ftp"
    assert checkout.stamps == {".ready-sim", ".ready-dev"}


def test_the_packages_of_a_sourced_ros_do_not_come_in(checkout: Checkout) -> None:
    checkout.python()
    checkout.run("make", "ready-sim")
    program = checkout.venv / "bin/companion"
    program.write_text('#!/usr/bin/env sh\necho "path: $PYTHONPATH"\n')
    assert "path: \n" in checkout.run("make", "demo", PYTHONPATH="/opt/ros/lib").stdout


def test_make_alone_lists_every_target_with_what_it_does(checkout: Checkout) -> None:
    listed = checkout.run("make").stdout
    targets = ("demo", "test", "test-slow", "lint", "types", "check", "interop", "bench", "clean", "help")
    for target in (*targets, *(f"bench-{name}" for name in ("clipseg", "link", "stopping", "vision"))):
        assert f"make {target} " in listed


def test_clean_leaves_what_a_demo_wrote(checkout: Checkout) -> None:
    checkout.python()
    (checkout.root / "demo-out").mkdir()
    checkout.run("make", "demo")
    checkout.run("make", "clean")
    assert not checkout.venv.exists()
    assert (checkout.root / "demo-out").exists()


GATE = ("ready-dev", "ready-export", "lint", "types", "test", "test-slow", "interop")


@pytest.mark.parametrize("failing", GATE)
def test_the_gate_fails_with_any_of_its_steps(tmp_path: Path, failing: str) -> None:
    (tmp_path / ".ci").mkdir()
    shutil.copy(ROOT / ".ci/run", tmp_path / ".ci")
    targets = "".join(f"{name}:\n\t@{'false' if name == failing else 'true'}\n" for name in GATE)
    (tmp_path / "Makefile").write_text(targets)
    done = subprocess.run([".ci/run"], cwd=tmp_path, capture_output=True, text=True, timeout=30, check=False)
    assert done.returncode != 0
    assert re.search(rf"ci: make .*{failing}\b", done.stdout)
    assert "all passed" not in done.stdout
