"""The operator's side must import where only pymavlink is installed, and leave the process as it was.

MAVProxy, which its module is loaded by, is stood in for: `make interop` runs the real one.
"""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import gcs_plugin

_PROGRAM = """
import importlib, os, pkgutil, sys, types

for name in ("MAVProxy", "MAVProxy.modules", "MAVProxy.modules.lib"):
    sys.modules[name] = types.ModuleType(name)
sys.modules["MAVProxy.modules.lib"].mp_module = types.SimpleNamespace(MPModule=object)

class Refuse:
    def find_spec(self, name, path=None, target=None):
        heavy = {"cv2", "onnxruntime", "numpy", "serial", "torch", "PIL", "starlette", "uvicorn"}
        if name.partition(".")[0] in heavy:
            raise ImportError(name + " must not be needed here")

sys.meta_path.insert(0, Refuse())
before = dict(os.environ)
import gcs_plugin
for module in pkgutil.walk_packages(gcs_plugin.__path__, "gcs_plugin."):
    if module.name != "gcs_plugin.console.server":  # it needs the extra `ground`
        importlib.import_module(module.name)
changed = {key for key in os.environ if os.environ[key] != before.get(key)}
assert not changed, changed
ours = {name for name in sys.modules if name.partition(".")[0] in {"companion", "anytraverse"}}
for name in sorted(ours):
    print(name)
"""


def test_every_module_imports_with_pymavlink_alone_and_sets_no_environment() -> None:
    environment = {key: value for key, value in os.environ.items() if not key.startswith("MAVLINK")}
    done = subprocess.run(
        [sys.executable, "-c", _PROGRAM],
        env=environment,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    imported = set(done.stdout.split())
    allowed = {
        "companion",
        "companion.pages",
        "companion.pages.calls",
        "companion.pages.given",
        "companion.pages.listen",
        "companion.pages.requests",
        "companion.pages.wording",
        "companion.system",
        "companion.system.atomic_write",
        "anytraverse",
        "anytraverse.release",
        "anytraverse.preferences",
        "anytraverse.errors",
        "anytraverse.operations",
        "anytraverse.picture_size",
        "anytraverse.regular_file",
    }
    assert {name for name in imported if not name.startswith("companion.wire")} <= allowed


def test_no_module_is_longer_than_a_reader_bears() -> None:
    for module in Path(gcs_plugin.__path__[0]).glob("*.py"):
        assert len(module.read_text().splitlines()) <= 300, module.name
