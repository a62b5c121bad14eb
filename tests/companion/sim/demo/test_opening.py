"""What is read first: it comes before what takes a busy computer seconds to import."""

from __future__ import annotations

import subprocess
import sys

import pytest

from companion.sim.demo.opening import opening

_WITHOUT_NUMPY = """
import sys
from importlib.abc import MetaPathFinder

class Refuses(MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name in {"numpy", "pymavlink"}:  # OpenCV needs NumPy, and is only looked for
            raise ImportError(name + " was imported")

sys.meta_path.insert(0, Refuses())
from companion.cli import main
main(sys.argv[1:])
"""


@pytest.mark.slow
@pytest.mark.parametrize(
    ("options", "line"),
    [
        ([], "`quit` ends the demo"),
        (["--auto"], "Field, daemon and operator start."),
        (["--auto", "--guide"], "The path is wide here."),
        (["--console"], "The console opens in your browser"),
        (["--camera", "folder:x"], "The daemon and the operator's terminal start."),
    ],
)
def test_the_story_begins_before_anything_heavy_is_imported(options: list[str], line: str) -> None:
    ran = subprocess.run(
        [sys.executable, "-c", _WITHOUT_NUMPY, "demo", *options], capture_output=True, text=True, check=False
    )
    assert line in ran.stdout
    assert "was imported" in ran.stderr


def test_only_a_person_is_told_what_is_theirs_to_do() -> None:
    assert "You are that operator" in opening(auto=False, console=False, guide=False, camera=None)
    assert "You are that operator" not in opening(auto=True, console=False, guide=False, camera=None)
