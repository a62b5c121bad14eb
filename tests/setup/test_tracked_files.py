"""What must not stand in any tracked file."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]

# In pieces, so that this file does not hold them.
REGISTRIES = re.compile(
    "|".join(
        [
            r"\bpypi" + r"\.org",
            "python" + r"hosted\.org",
            "pi" + r"wheels\.org",
            r"conda\." + r"anaconda\.org",
            r"registry\." + r"npmjs",
            r"--(extra-)?index" + "-url",
            "--find" + "-links",
        ]
    )
)


@pytest.fixture(scope="module")
def tracked() -> list[Path]:
    git = shutil.which("git") or pytest.skip("git is not on this machine")
    listed = subprocess.run(
        [git, "-C", str(ROOT), "ls-files", "-z"], capture_output=True, text=True, timeout=30, check=False
    )
    if listed.returncode != 0:
        pytest.skip("this is no git checkout")
    files = [ROOT / name for name in listed.stdout.split("\0") if name]
    return [path for path in files if path.is_file()]


@pytest.mark.slow
def test_no_tracked_file_names_a_package_index(tracked: list[Path]) -> None:
    named = [str(path) for path in tracked if REGISTRIES.search(path.read_bytes().decode(errors="replace"))]
    assert named == []


def test_the_pattern_knows_an_index_when_it_sees_one() -> None:
    assert REGISTRIES.search("https://" + "pypi" + ".org/simple")


def test_the_licence_is_whole() -> None:
    text = (ROOT / "LICENSE").read_text()
    assert "Version 2.0, January 2004" in text
    assert "END OF TERMS AND CONDITIONS" in text
