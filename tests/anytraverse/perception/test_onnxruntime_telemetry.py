"""ONNX Runtime as it is loaded here does not report to its maker, and leaves the home alone."""

import os
import subprocess
import sys
from pathlib import Path

LOADING = """
import os
from anytraverse.bundle.machine import this_machine
from anytraverse.perception.clipseg import perceiver
from anytraverse.perception.runtime import available_providers
assert "CPU" in available_providers() and this_machine().onnxruntime != "none"
print(os.environ.get("ORT_DISABLE_TELEMETRY"))
"""


def loaded(home: Path, **told: str) -> str:
    hushed = ("ORT_", "XDG_", "CI", "GITHUB_")  # in CI it is silent by itself
    kept = {name: value for name, value in os.environ.items() if not name.startswith(hushed)}
    done = subprocess.run(
        [sys.executable, "-c", LOADING],
        env={**kept, "HOME": str(home), **told},
        capture_output=True,
        text=True,
        timeout=60,
        check=True,
    )
    return done.stdout.strip()


def test_nothing_is_kept_in_the_home_and_telemetry_is_off(tmp_path: Path) -> None:
    assert loaded(tmp_path) == "1"
    assert list(tmp_path.iterdir()) == []


def test_who_wants_telemetry_may_say_so(tmp_path: Path) -> None:
    assert loaded(tmp_path, ORT_DISABLE_TELEMETRY="0") == "0"
