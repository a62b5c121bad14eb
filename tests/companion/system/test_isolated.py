"""A module runs without the current folder on Python's path, but with all else that is on it."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[3]
RUN = """
import subprocess, sys
from companion.system.isolated import isolated
subprocess.run(isolated("wanted"), check=True)
print(*sys.path, sep="\\n")
"""


def test_what_comes_by_the_python_path_is_found_and_nothing_of_the_current_folder(tmp_path: Path) -> None:
    beside, here = tmp_path / "beside", tmp_path / "here"
    beside.mkdir()
    here.mkdir()
    (beside / "wanted.py").write_text(
        "import json, sys\nprint(json.__file__, len(sys.path))\nprint(*sys.path, sep='\\n')"
    )
    for name in ("json.py", "wanted.py"):
        (here / name).write_text("print('of somebody')")
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(["", str(ROOT), str(beside)])}
    command = [sys.executable, "-c", RUN]
    ran = subprocess.run(
        command, cwd=here, env=environment, capture_output=True, text=True, timeout=30.0, check=True
    )
    assert ran.stderr == ""
    (library, count), *lines = (line.split() for line in ran.stdout.splitlines())
    path, whole = lines[: int(count)], lines[int(count) :]
    assert not library.startswith(str(tmp_path))
    assert [str(beside)] in path
    assert path == [one for one in whole if one not in ([], [str(here)])], "in the same order"
