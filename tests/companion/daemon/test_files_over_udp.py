"""`companion run` with a call open, and pymavlink's own file client on a socket."""

from __future__ import annotations

import io
import json
import threading
import zipfile
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from pymavlink import mavftp, mavutil

from companion import run
from companion.config import load_config
from companion.desk.check.table import CHECKS
from companion.vision.pictures import LIMIT
from companion.wire.answers import Answer, PackIncident
from companion.wire.call_report import CallReport
from companion.wire.ids import COMPONENT_ID, TUNNEL_ANSWER, TUNNEL_CALL, Motion
from companion.wire.incidents import Incidents, read_incidents
from tests.companion.processes import painted_config
from tests.companion.vision import painted
from tests.waiting import wait_for


@pytest.fixture
def ground(tmp_path: Path) -> Iterator[Any]:
    """A ground station's connection to a companion before whose wheels lies a drum without a word."""
    master = mavutil.mavlink_connection("udpin:127.0.0.1:0", source_system=255, source_component=190)
    config = painted_config(tmp_path, master.port.getsockname()[1], link="budget = 0\nasked_budget = 0")
    painted.register()
    over = threading.Event()
    given = (load_config(str(config)), over.is_set, painted.COMMAND)
    thread = threading.Thread(target=run.main, args=given)
    thread.start()
    yield master
    over.set()
    thread.join()
    master.close()


def call_told(master: Any) -> CallReport:
    """The first that names its picture, which is drawn a little later."""
    for _ in range(500):
        message = master.recv_match(type="TUNNEL", blocking=True, timeout=10)
        assert message is not None
        if message.payload_type == TUNNEL_CALL:
            told = CallReport.unpack(bytes(message.payload[: message.payload_length]))
            if told.picture:
                return told
    raise AssertionError("no call with a picture")


@pytest.mark.slow
def test_a_call_is_listed_and_fetched_by_pymavlinks_client(ground: Any, tmp_path: Path) -> None:
    call = call_told(ground)
    client = mavftp.MAVFTP(ground, 1, COMPONENT_ID)

    def listed(folder: str) -> dict[str, int]:
        return {entry.name: entry.size_b for entry in client.cmd_list([folder]).directory_listing}

    def fetched(path: str) -> bytes:
        copy = tmp_path / "copy"
        client.cmd_get([path, str(copy)])
        assert client.process_ftp_reply("Get", timeout=20).error_code == 0
        return copy.read_bytes()

    files = {"state.json", "check.json", "incidents.json"}
    folders = {"@PARAM", "calls", "maps", "scenes", "logs", "incidents"}
    assert listed("/").keys() == files | folders
    number = call.id
    wanted = {f"{number}.json", f"{number}.jpg", f"{number}-large.jpg", f"{number}-raw.jpg"}
    # A picture is named when it is drawn, and there a moment later.
    wait_for(lambda: listed("/calls").keys() >= wanted, 10.0)
    assert listed("/logs").keys() == {"companion.log"}
    state = json.loads(fetched("/state.json"))
    assert (state["state"], state["open"]["id"], state["words"]) == ("calling", number, {"grass": 1.0})
    assert json.loads(fetched(f"/calls/{number}.json"))["reasons"] == ["unknown_object"]
    assert len(json.loads(fetched("/check.json"))["checks"]) >= len(CHECKS)
    small = fetched(call.picture)
    assert len(small) <= LIMIT
    assert cv2.imdecode(np.frombuffer(small, np.uint8), cv2.IMREAD_COLOR) is not None
    assert read_incidents(fetched("/incidents.json")) == Incidents()
    asked = Answer(0, Motion.NONE, (PackIncident(number),), 4711).pack()
    ground.mav.tunnel_send(1, COMPONENT_ID, TUNNEL_ANSWER, len(asked), asked.ljust(128, b"\0"))
    (incident,) = wait_for(lambda: read_incidents(fetched("/incidents.json")).packed, 60.0)
    assert (incident.call, incident.note) == (
        number,
        "without a recording: switched off by [recording] size",
    )
    content = fetched(f"/incidents/{incident.name}-short.zip")
    with zipfile.ZipFile(io.BytesIO(content)) as found:
        assert found.testzip() is None
        assert {f"calls/{number}.json", "config.toml", "versions.json"} <= set(found.namelist())
    assert len(content) == incident.short
    assert fetched("/maps/uncertainty.png").startswith(b"\x89PNG")
