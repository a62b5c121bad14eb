"""Records drive.mcap, the drive of the tests, anew: `python -m tests.companion.desk.drives.record_drive`.

A simulated rover drives from the meadow into the forest, past a thing. Only what a replay needs is kept.
"""

from __future__ import annotations

import json
import re
import tempfile
import time
from functools import partial
from pathlib import Path

from companion.desk.check.here import read_status
from companion.observers.recording.reading import Copy, Read, messages
from companion.observers.recording.topics import TOPICS, Topic
from companion.sim.demo.child import LoggedProcess
from companion.sim.demo.config import write_config
from companion.sim.field.control import FieldControl
from tests.waiting import wait_for

DRIVE = Path(__file__).with_name("drive.mcap")
_SECONDS, _EVERY, _FRAMES = 60.0, 3, 17
_KEPT = {
    TOPICS[topic].name for topic in (Topic.CAMERA, Topic.ASSESSMENT, Topic.WORDS, Topic.SETTINGS, Topic.SETUP)
}


def main() -> None:
    """Drive, record, and write every third of the recorded frames, 17 in all, with its assessment."""
    with tempfile.TemporaryDirectory() as folder:
        _record(Path(folder))
        found = [
            one
            for path in sorted(Path(folder, "state", "recordings").glob("*.mcap"))
            for one in messages(path, _KEPT)
        ]
    every = sorted({one.message.sequence for one in found if one.channel.topic == "/camera"})
    frames = every[::_EVERY][:_FRAMES]
    with DRIVE.open("wb") as file:
        copy = Copy(file)
        for one in found:
            of_a_frame = one.channel.topic in ("/camera", "/assessment")
            if not of_a_frame or one.message.sequence in frames:
                copy.add(_without_names(one))
        copy.finish()
    print(f"{DRIVE}: {len(frames)} frames, {DRIVE.stat().st_size} bytes")


def _record(folder: Path) -> None:
    field = LoggedProcess(
        "field", ["companion.sim.field", "--seed", "0", "--speed", "1.5"], folder / "field.log"
    )
    ports = json.loads(field.first_line(30.0))
    host, _, port = ports["control"].rpartition(":")
    control = FieldControl(host, int(port))
    config = write_config(
        folder, camera=f"field:{ports['frames']}", link=ports["companion"], policy="report", speed=1.5
    )
    on = "[recording]\nsize = 200\nrate = 1.0"
    config.write_text(re.sub(r"\[recording\]\nsize = 0", on, config.read_text()))
    daemon = LoggedProcess("daemon", ["companion", "run", str(config)], folder / "daemon.log")
    state, unseen = folder / "state", partial(daemon.error, "saw nothing that it knows")
    wait_for(lambda: read_status(state)[1].get("state") == "ok", 40.0, unseen)
    control.start()
    time.sleep(_SECONDS)
    daemon.stop()
    control.close()
    field.stop()


def _without_names(one: Read) -> Read:
    """Leave out where and on what the drive was recorded, and how the vehicle stood."""
    if one.channel.topic not in ("/setup", "/assessment"):
        return one
    told = {key: value for key, value in json.loads(one.message.data).items() if key not in ("lean", "pose")}
    if one.channel.topic == "/setup":
        told["computer"] = "simulated"
        told["config"] = re.sub(r'(?m)^(source|url|folder) = "[^"]+"', _neutral, told["config"])
    one.message.data = json.dumps(told).encode()
    return one


def _neutral(found: re.Match[str]) -> str:
    values = {"source": "folder:pictures", "url": "udpout:127.0.0.1:14550", "folder": "state"}
    return f'{found[1]} = "{values[found[1]]}"'


if __name__ == "__main__":
    main()
