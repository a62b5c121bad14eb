"""The recipe of the image, without building one: `make image-check` does that."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
from itertools import pairwise
from pathlib import Path

import pytest

from bench.service.podman import HARDENED

ROOT = Path(__file__).resolve().parents[2]
RECIPE = ROOT / ".ci/image.sh"
DOCS = (ROOT / "docs/install.md").read_text(encoding="utf-8")


@pytest.mark.parametrize("file", [".ci/deb.sh", ".ci/image.sh"])
def test_the_shell_can_read_the_recipe(file: str) -> None:
    done = subprocess.run(["sh", "-n", ROOT / file], capture_output=True, text=True, check=False)
    assert (done.returncode, done.stderr) == (0, "")


@pytest.fixture
def programs(tmp_path: Path) -> Path:
    """A checkout of the recipe alone, and the folder of all programs that it finds: it builds nothing."""
    (tmp_path / ".ci").mkdir()
    shutil.copy(RECIPE, tmp_path / ".ci")
    shutil.copy(ROOT / "pyproject.toml", tmp_path)
    folder = tmp_path / "bin"
    folder.mkdir()
    for tool in ("sh", "sed", "dirname"):
        os.symlink(shutil.which(tool) or "", folder / tool)
    says(folder, "id", "0")
    says(folder, "dpkg", "amd64")
    return folder


def says(folder: Path, program: str, text: str) -> None:
    (folder / program).write_text(f"#!/bin/sh\necho {text}\n")
    (folder / program).chmod(0o755)


def refusal(programs: Path, **environment: str) -> str:
    done = subprocess.run(
        ["sh", ".ci/image.sh"],
        cwd=programs.parent,
        env={"PATH": str(programs), **environment},
        capture_output=True,
        text=True,
        timeout=30,
        check=False,
    )
    assert (done.returncode, done.stdout) == (1, "")
    (line,) = done.stderr.splitlines()
    return line


def test_what_is_missing_is_told_with_what_to_type(programs: Path) -> None:
    says(programs, "mmdebstrap", "")
    assert refusal(programs) == "image: type: sudo apt install --no-install-recommends buildah"
    (programs / "mmdebstrap").unlink()
    assert refusal(programs).endswith("--no-install-recommends mmdebstrap buildah")


def test_it_needs_root(programs: Path) -> None:
    says(programs, "id", "1000")
    assert refusal(programs) == "image: this needs root: type: sudo make image"


def test_for_another_kind_of_computer_its_package_has_to_be_there(programs: Path) -> None:
    says(programs, "mmdebstrap", "")
    says(programs, "buildah", "")
    said = refusal(programs, ARCH="arm64")
    assert re.search(r"no dist/anytraverse-companion_\S+_arm64\.deb: type make deb on a computer", said)


def test_the_image_has_the_watchdog_of_the_unit() -> None:
    unit = (ROOT / "systemd/companion.service").read_text()
    period = re.search(r"(?m)^WatchdogSec=(\d+)$", unit)
    assert period is not None
    assert f"WATCHDOG_USEC={period[1]}000000 " in RECIPE.read_text()


def test_the_page_runs_it_as_it_is_proven() -> None:
    (command,) = re.findall(r"podman run -d (?:.*\\\n)*.*", DOCS)
    words = command.replace("\\\n", " ").split()
    typed = {f"{one}={two}" for one, two in pairwise(words) if one.startswith("-")} | {*words}
    volumes = {"-v=/etc/anytraverse:/etc/anytraverse:ro", "-v=anytraverse:/var/lib/anytraverse"}
    assert {*HARDENED, "--restart=always", *volumes} <= typed
