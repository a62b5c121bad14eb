"""The supervisor runs without OpenCV and ONNX Runtime: what they may do to a process is done elsewhere."""

from __future__ import annotations

import json
import os
import socket
import subprocess
import sys
from pathlib import Path

import pytest

from companion.observers.page.page import missing
from tests.companion.processes import ROOT, painted_config

SCRIPT = """
import json, sys, time
from pathlib import Path
from anytraverse.perception import KINDS
KINDS["painted"] = ("tests.companion.vision.painted", "Obedient")
from companion.config import load_config
from companion.run import main
config, status = load_config(sys.argv[1]), Path(sys.argv[2])
until, page = time.monotonic() + 30.0, {}

def called():
    told = json.loads(status.read_text()) if status.is_file() else {}
    pictures = list((status.parent / "calls").glob("*-large.jpg"))
    page.update(told.get("web", {}))
    shown = page.get("trouble", "starting") != "starting"
    return bool(told.get("current_id") and pictures and shown) or time.monotonic() > until

code = main(config, called, (sys.executable, "-m", "tests.companion.vision.painted"))
print(json.dumps({"code": code, "modules": sorted(sys.modules), "page": page}))
"""


@pytest.mark.slow
def test_the_supervisor_never_imports_opencv_or_onnx_runtime(tmp_path: Path) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as ground:
        ground.bind(("127.0.0.1", 0))
        path = painted_config(tmp_path, ground.getsockname()[1], web='listen = "127.0.0.1:0"')
        ran = subprocess.run(
            [sys.executable, "-c", SCRIPT, str(path), str(tmp_path / "state" / "status.json")],
            cwd=ROOT,
            env={**os.environ, "PYTHONPATH": str(ROOT)},
            capture_output=True,
            text=True,
            timeout=60,
            check=True,
        )
    told = json.loads(ran.stdout.splitlines()[-1])
    assert told["code"] == 0
    assert {"companion.daemon.daemon", "companion.vision.client"} <= set(told["modules"])
    networks = {"cv2", "onnxruntime", "tokenizers", "torch"}
    pages = {"starlette", "uvicorn", "prometheus_client", "asyncio"}
    heavy = {name for name in told["modules"] if name.partition(".")[0] in networks | pages}
    assert heavy == set()
    own = {"companion.vision.worker", "companion.vision.pictures", "companion.vision.process"}
    assert not own & set(told["modules"])
    assert list((tmp_path / "state" / "calls").glob("*-large.jpg")), "it saw, called and had it drawn"
    assert "companion.observers.page.page" in told["modules"]
    assert missing() or told["page"]["url"], "it had a page"
