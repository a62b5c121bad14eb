"""What pymavlink's file client makes of a companion, as a line of JSON: mavftp_client.py udpout:HOST:PORT"""

from __future__ import annotations

import json
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from pymavlink import mavutil
from pymavlink.mavftp import MAVFTP

COMPANION = 191


def main(link: str) -> dict[str, Any]:
    """List, and fetch what is not there."""
    master = mavutil.mavlink_connection(link, source_system=255, source_component=190)
    deadline = time.monotonic() + 10.0
    while time.monotonic() < deadline:
        master.mav.heartbeat_send(
            mavutil.mavlink.MAV_TYPE_GCS, mavutil.mavlink.MAV_AUTOPILOT_INVALID, 0, 0, 4
        )
        heard = master.recv_match(type="HEARTBEAT", blocking=True, timeout=0.5)
        if heard is not None and heard.get_srcComponent() == COMPANION:
            break
    client = MAVFTP(master, heard.get_srcSystem(), COMPANION)
    listed = client.cmd_list(["/"])
    names = [entry.name for entry in client.list_result]
    with tempfile.TemporaryDirectory() as folder:
        copy = Path(folder) / "state.json"
        client.cmd_get(["/state.json", str(copy)])
        client.process_ftp_reply("OpenFileRO", timeout=20)
        state = json.loads(copy.read_text())
    begun = time.monotonic()
    client.cmd_get(["/no-such-file", "nothing"])
    missing = client.process_ftp_reply("OpenFileRO", timeout=10)
    return {
        "listed": listed.error_code,
        "names": names,
        "state": state,
        "missing": missing.error_code,
        "missing after": time.monotonic() - begun,
    }


if __name__ == "__main__":
    print(json.dumps(main(sys.argv[1])), flush=True)
