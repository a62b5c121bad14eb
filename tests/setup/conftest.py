"""A small checkout with the real Makefile and set-up script, and interpreters that only pretend."""

import json
import os
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
TOOLS = ["basename", "cat", "cksum", "cp", "df", "dirname", "env", "find", "grep", "make", "mkdir"]
TOOLS += ["ln", "paste", "readlink", "rm", "sed", "sh", "tail", "tr"]

# Answers the script's questions with the facts of its own JSON file, and notes every call of venv and pip.
FAKE = """#!{python} -IS
import json, os, shutil, struct, sys
here = os.path.abspath(sys.argv[0])
facts = json.load(open({facts!r}))
what = sys.argv[1:3]
if what[0] == "-c":
    sys.version_info = tuple(facts["version"]) + ("final", 0)
    sys.base_prefix = facts["base"]
    sys.prefix = os.path.dirname(os.path.dirname(here))
    struct.calcsize = lambda _: facts["bits"] // 8
    if not facts["ensurepip"]:
        sys.modules["ensurepip"] = None
    sys.argv = sys.argv[1:]
    exec(what[1])
    sys.exit()
with open({calls!r}, "a") as calls:
    calls.write(" ".join(sys.argv[1:]) + chr(10))
if what == ["-m", "venv"]:
    os.makedirs(sys.argv[-1] + "/bin")
    shutil.copy(here, sys.argv[-1] + "/bin/python")
    shutil.copy(here, sys.argv[-1] + "/bin/companion")
    for name, content in facts.get("makes", {{}}).items():
        os.makedirs(os.path.dirname(sys.argv[-1] + "/" + name), exist_ok=True)
        with open(sys.argv[-1] + "/" + name, "w") as made:
            made.write(content)
if what == ["-m", "pip"]:
    print(facts["pip_says"])
    if facts["pip_kills_the_script"]:
        os.kill(os.getppid(), 9)
    sys.exit(facts["pip_exits"])
"""
HEALTHY = {
    "version": [3, 11, 2],
    "bits": 64,
    "ensurepip": True,
    "base": "/usr",
    "pip_says": "Successfully installed",
    "pip_exits": 0,
    "pip_kills_the_script": False,
}


@dataclass
class Checkout:
    """A folder with the set-up files, and a PATH that holds nothing but tools and fake interpreters."""

    root: Path
    bin: Path

    @property
    def venv(self) -> Path:
        return self.root / ".venv"

    @property
    def stamps(self) -> set[str]:
        return {stamp.name for stamp in self.venv.glob(".ready-*")}

    @property
    def calls(self) -> list[str]:
        """Every call of venv, pip and the installed programs so far."""
        noted = self.root / "calls"
        return noted.read_text().splitlines() if noted.exists() else []

    def python(self, name: str = "python3", **facts: object) -> Path:
        """Puts a fake interpreter on the PATH, or changes the facts of the one that is there."""
        told = self.root / f"{name}.json"
        told.write_text(json.dumps(HEALTHY | facts))
        fake = self.bin / name
        fake.write_text(FAKE.format(python=sys.executable, facts=str(told), calls=str(self.root / "calls")))
        fake.chmod(0o755)
        return fake

    def run(self, *command: str, **environment: str) -> subprocess.CompletedProcess[str]:
        return subprocess.run(
            command,
            cwd=self.root,
            env={"PATH": str(self.bin), **environment},
            capture_output=True,
            text=True,
            timeout=30,
            check=False,
        )

    def set_up(self, extra: str = "sim", **environment: str) -> subprocess.CompletedProcess[str]:
        return self.run("sh", ".ci/setup.sh", extra, **environment)

    def refusal(self, extra: str = "sim", **environment: str) -> str:
        """What a set-up that must fail says; it must be one line."""
        done = self.set_up(extra, **environment)
        assert done.returncode != 0
        (line,) = done.stderr.splitlines()
        return line


@pytest.fixture
def checkout(tmp_path: Path) -> Checkout:
    root, binaries = tmp_path / "check out", tmp_path / "bin"
    (root / ".ci").mkdir(parents=True)
    binaries.mkdir()
    shutil.copy(ROOT / ".ci/setup.sh", root / ".ci")
    shutil.copy(ROOT / "Makefile", root)
    shutil.copy(ROOT / "pyproject.toml", root)
    for tool in TOOLS:
        found = shutil.which(tool) or pytest.skip(f"{tool} is not on this machine")
        os.symlink(found, binaries / tool)
    return Checkout(root, binaries)
