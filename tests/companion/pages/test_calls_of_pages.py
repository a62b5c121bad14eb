"""What all pages say of calls, run by Node.js where that is installed."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

import companion.pages

NODE = shutil.which("node")
MODULE = Path(companion.pages.__path__[0], "static", "calls.js")
pytestmark = pytest.mark.skipif(NODE is None, reason="Node.js is not installed")
CALL: dict[str, Any] = {
    "key": "7-1",
    "kind": "call",
    "name": "C7",
    "stage": "open",
    "open": True,
    "reason": "Unknown thing.",
    "stands": "The vehicle is held.",
    "todo": "What is in the yellow frame?",
}


def said(folder: Path, expression: str) -> Any:
    assert NODE is not None
    (folder / "calls.mjs").write_bytes(MODULE.read_bytes())
    script = folder / "script.mjs"
    script.write_text(
        "import { Untold, aloud, titled } from './calls.mjs';\n"
        f"const call = {json.dumps(CALL)}, untold = new Untold();\n"
        f"console.log(JSON.stringify({expression}));"
    )
    ran = subprocess.run([NODE, str(script)], capture_output=True, text=True, timeout=30.0, check=True)
    return json.loads(ran.stdout)


def test_a_call_is_read_aloud_with_what_stands_and_what_to_do(tmp_path: Path) -> None:
    assert said(tmp_path, "[titled(call), titled({ ...call, kind: 'hold', name: 'H7' })]") == [
        "Call C7",
        "Hold H7",
    ]
    told = said(tmp_path, "[aloud(call), aloud({ ...call, stands: '', todo: '' })]")
    assert told[0] == f"C7. {CALL['reason']} {CALL['stands']} {CALL['todo']}"
    assert told[1] == f"C7. {CALL['reason']}"


def test_each_open_call_is_told_once_and_again_when_it_is_clear(tmp_path: Path) -> None:
    assert said(
        tmp_path,
        "[untold.take([call], 1), untold.take([call], 1), untold.take([call], 2),"
        " untold.take([{ ...call, stage: 'clear' }], 1),"
        " untold.take([{ ...call, key: '8-1', open: false }], 1)]"
        ".map((found) => found.length)",
    ) == [1, 0, 1, 1, 0]
