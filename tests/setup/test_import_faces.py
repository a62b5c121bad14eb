"""Which modules may be imported where OpenCV, onnxruntime or even pymavlink are missing."""

import json
import subprocess
import sys
from typing import Any

import pytest

from anytraverse.release import own_version

# Imports what the arguments name (with every module below, for "name.*") while some packages cannot be found.
PROBE = """
import importlib, json, os, pkgutil, sys

blocked, wanted = json.loads(sys.argv[1]), json.loads(sys.argv[2])
excused = {"MAVProxy", "torch"} - set(blocked)  # what only MAVProxy loads, and only a workstation

class Absent:
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in blocked:
            raise ModuleNotFoundError(f"{name} is not installed here", name=name)

sys.meta_path.insert(0, Absent())
before = dict(os.environ)

def load(name):
    try:
        return importlib.import_module(name)
    except ModuleNotFoundError as error:
        if (error.name or "").partition(".")[0] not in excused:
            raise

for name in wanted:
    face = load(name.removesuffix(".*"))
    if name.endswith(".*"):
        for found in pkgutil.walk_packages(face.__path__, face.__name__ + "."):
            # The console's server needs the extra `ground`; its program says so and imports it last.
            if not found.name.endswith(("__main__", "console.server")):
                load(found.name)
changed = sorted(k for k in {**before, **os.environ} if before.get(k) != os.environ.get(k))
print(json.dumps({"modules": sorted(sys.modules), "environment": changed}))
"""
VISION = ["cv2", "onnxruntime", "torch", "PIL", "depthai"]


def imported(wanted: list[str], without: list[str]) -> dict[str, Any]:
    """The modules loaded, and the environment variables changed, by importing these in a fresh process."""
    done = subprocess.run(
        [sys.executable, "-c", PROBE, json.dumps(without), json.dumps(wanted)],
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    outcome: dict[str, Any] = json.loads(done.stdout.splitlines()[-1])
    return outcome


@pytest.mark.parametrize("face", ["anytraverse", "companion", "gcs_plugin"])
def test_a_packages_face_needs_nothing_that_is_installed(face: str) -> None:
    imported([face], [*VISION, "numpy", "pymavlink", "serial"])


def test_every_module_of_the_operators_side_imports_in_mavproxys_environment() -> None:
    absent = [*VISION, "starlette", "uvicorn"]
    imported(["gcs_plugin.*", "companion.wire.*", "anytraverse.preferences"], absent)


def test_the_daemon_starts_without_what_records_or_shows() -> None:
    shows = ["mcap", "foxglove", "starlette", "uvicorn", "prometheus_client", "tomlkit"]
    imported(["companion.run"], [*VISION, "serial", *shows])


def test_the_wires_definition_needs_no_link() -> None:
    imported(["companion.wire.*"], [*VISION, "serial"])


def test_the_operators_side_knows_of_the_rest_only_the_wire_the_words_and_what_is_as_light() -> None:
    light = [
        "anytraverse.picture_size",
        "anytraverse.preferences",
        "anytraverse.release",
        "companion.pages.*",
    ]
    shared = imported(["companion.wire.*", *light], VISION)["modules"]
    loaded = imported(["gcs_plugin.*"], VISION)["modules"]
    more = set(loaded) - set(shared)
    assert [name for name in sorted(more) if name.startswith(("companion.", "anytraverse."))] == []


@pytest.mark.slow
def test_the_algorithm_knows_nothing_of_the_daemon() -> None:
    loaded = imported(["anytraverse.*"], ["pymavlink"])["modules"]
    assert [name for name in loaded if name.startswith(("companion", "gcs_plugin"))] == []


def test_the_operators_side_leaves_mavproxys_environment_variables_alone() -> None:
    assert imported(["gcs_plugin.*"], VISION)["environment"] == []


@pytest.mark.slow
@pytest.mark.parametrize(
    "module", ["anytraverse.cli", "companion.cli", "companion", "gcs_plugin.terminal", "gcs_plugin.console"]
)
def test_each_program_tells_its_version(module: str) -> None:
    told = subprocess.run(
        [sys.executable, "-m", module, "--version"], capture_output=True, text=True, check=True, timeout=60
    )
    assert told.stdout.split()[-1] == own_version()


@pytest.mark.parametrize("module", ["companion.sim.field", "companion.wire.tables"])
def test_each_module_that_the_pages_start_runs(module: str) -> None:
    done = subprocess.run(
        [sys.executable, "-m", module, "--help"], capture_output=True, timeout=60, check=False
    )
    assert (done.returncode, done.stderr) == (0, b"")
