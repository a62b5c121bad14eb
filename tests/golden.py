"""Compares what is told with what was told before: a file of JSON texts beside the test."""

from __future__ import annotations

import json
import os
import re
from pathlib import Path
from typing import Any

WRITE = "GOLDEN"
"""With this variable set, the files are written and not compared."""
_LONG = re.compile(r"\d+\.\d{10,}")
"""Numbers whose last digits depend on the processor."""


def compare(path: Path, told: dict[str, Any]) -> None:
    """Fail where something is told otherwise than in the file. told: JSON values; texts count to the byte."""
    if os.environ.get(WRITE):
        path.write_text(json.dumps(told, indent=1, sort_keys=True) + "\n", encoding="utf-8")
    before = json.loads(path.read_text(encoding="utf-8"))
    assert told.keys() == before.keys()
    for name, one in told.items():
        assert _settled(one) == _settled(before[name]), name


def _settled(told: Any) -> Any:
    text = _LONG.sub(lambda found: repr(round(float(found[0]), 9)), json.dumps(told))
    return json.loads(text)
