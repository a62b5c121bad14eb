"""What somebody writes into a field of the settings, run by Node.js where that is installed."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

import companion.pages

NODE = shutil.which("node")
STATIC = Path(companion.pages.__path__[0], "static")
pytestmark = pytest.mark.skipif(NODE is None, reason="Node.js is not installed")


def said(folder: Path, expression: str) -> Any:
    assert NODE is not None
    for name in ("fields.js", "elements.js"):
        (folder / name).write_bytes((STATIC / name).read_bytes())
    (folder / "package.json").write_text('{"type": "module"}')
    script = folder / "script.js"
    script.write_text(
        f"import {{ table, written }} from './fields.js';\nconsole.log(JSON.stringify({expression}));"
    )
    ran = subprocess.run([NODE, str(script)], capture_output=True, text=True, timeout=30.0, check=True)
    return json.loads(ran.stdout)


@pytest.mark.parametrize(
    ("table", "of"),
    [
        ({"dry grass": 1, "rock": -0.8}, "number"),
        ({"grass": "GR", "rock": "42"}, "text"),
        ({"wifi.url": "udpin:127.0.0.1:14551", "wifi.budget": 500}, "any"),
        ({}, "any"),
    ],
)
def test_a_table_is_read_as_it_is_written(tmp_path: Path, table: dict[str, Any], of: str) -> None:
    there = f"table(written({json.dumps(table)}, '\\n'), '{of}')"
    assert said(tmp_path, there) == {"value": table}


@pytest.mark.parametrize(
    ("line", "table"),
    [
        ("constructor: 1", '{"constructor":1}'),
        ("__proto__: 1", '{"__proto__":1}'),
        ('"dry grass": 0,5', '{"dry grass":0.5}'),
        ("mud: \u22120.5", '{"mud":-0.5}'),
        ("mud: +1", '{"mud":1}'),
    ],
)
def test_a_line_is_read_as_people_write_it(tmp_path: Path, line: str, table: str) -> None:
    assert said(tmp_path, f"JSON.stringify(table({json.dumps(line)}, 'number').value)") == table


@pytest.mark.slow
@pytest.mark.parametrize(
    ("text", "why"),
    [
        ("grass", 'Write each line as NAME: VALUE, not "grass".'),
        (": 1", 'Write each line as NAME: VALUE, not ": 1".'),
        ("grass: 1\ngrass: 0", "grass stands twice."),
        ("grass: much", 'grass: "much" is no number.'),
        ("grass:", 'grass: "" is no number.'),
        ("grass: 0x1", 'grass: "0x1" is no number.'),
    ],
)
def test_a_line_that_is_none_is_said(tmp_path: Path, text: str, why: str) -> None:
    assert said(tmp_path, f"table({json.dumps(text)}, 'number')") == {"wrong": why}
