"""What the console's page makes of what it is told, run by Node.js where that is installed."""

from __future__ import annotations

import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import pytest

import companion.pages
import gcs_plugin.console
from companion.wire.ids import Policy

NODE = shutil.which("node")
FOLDERS = [Path(package.__path__[0], "static") for package in (companion.pages, gcs_plugin.console)]
pytestmark = pytest.mark.skipif(NODE is None, reason="Node.js is not installed")
ROVER: dict[str, Any] = {
    "heard": 7.0,
    "link": {"lost": None, "bytes": 0, "rate": None},
    "ahead": None,
    "vehicle": None,
    "offers_guide": False,
    "guiding": False,
}


def said(folder: Path, expression: str, **given: Any) -> Any:
    """What the expression is, which may use `model`, `wording` and what is given."""
    assert NODE is not None
    (folder / "package.json").write_text('{"type": "module"}')
    for module in (file for static in FOLDERS for file in static.glob("*.js")):
        (folder / module.name).write_bytes(module.read_bytes())
    script = folder / "script.mjs"
    script.write_text(
        "import * as model from './model.js'; import * as wording from './wording.js';"
        f" const {{{', '.join(given)}}} = {json.dumps(given)};\n"
        f"console.log(JSON.stringify({expression}));"
    )
    ran = subprocess.run([NODE, str(script)], capture_output=True, text=True, timeout=30.0, check=True)
    return json.loads(ran.stdout)


def test_every_policy_has_a_button_and_words(tmp_path: Path) -> None:
    words = said(tmp_path, "wording.POLICIES")
    assert words.keys() == {policy.name.lower() for policy in Policy}
    assert all(text.startswith(f"{name}: ") for name, text in words.items())


@pytest.mark.parametrize("offers", [True, False])
def test_guide_alone_is_offered_only_where_it_would_be_given(tmp_path: Path, offers: bool) -> None:
    rover = {**ROVER, "offers_guide": offers}
    offered = said(
        tmp_path, "Object.keys(wording.POLICIES).filter((one) => model.offered(rover, one))", rover=rover
    )
    assert ("guide" in offered) is offers
    assert set(offered) - {"guide"} == {"report", "shadow", "hold", "off"}


@pytest.mark.parametrize("guiding", [True, False])
def test_it_is_said_while_the_companion_drives_round_something(tmp_path: Path, guiding: bool) -> None:
    facts = dict(said(tmp_path, "model.facts(rover, 7)", rover={**ROVER, "guiding": guiding}))
    assert ("guiding" in facts) is guiding
