"""Measures what recording and the live view cost: CPU of each process, bytes, judging rate, latencies.

The whole companion runs with `builtin` on a folder of frames, at each rate of recorded frames in turn; 0 is
without a recorder. A word is set every two seconds, so that acknowledgements wait for the disk. --packing:
seconds after which an incident file of the last minute is packed again; 0: none is.
With `--viewers` a live view shows frames at each rate to so many viewers, and nothing is recorded.
Run: python -m bench.recording --frames DIR [--seconds 60] [--rates 0,1,10] [--camera 10] [--rounds 1]
     [--packing 0,12] [--viewers 2]
"""

from __future__ import annotations

import argparse
import asyncio
import json
import multiprocessing
import os
import signal
import subprocess
import sys
import tempfile
import time
from itertools import product
from pathlib import Path
from random import Random
from statistics import median
from typing import Any

from anytraverse.operations import SetWord
from bench.commit import commit_of
from bench.link.drive import at
from bench.processes import children
from companion.desk.check.here import read_status
from companion.observers.recording.packing import kept
from companion.wire.answers import Answer, PackIncident
from companion.wire.delivery import Pending
from companion.wire.ids import Motion
from gcs_plugin.client.client import OperatorClient
from gcs_plugin.terminal.connection import open_connection
from gcs_plugin.terminal.runner import Runner

ROOT = Path(__file__).resolve().parents[1]
_READY_WITHIN, _SETTLED = 60.0, 5.0
_EVERY = 2.0
_SYSTEM = 1
_CONFIG = """
[camera]
source = "folder:{frames}"
loop = true
rate = {camera}
playback = {camera}
[web]
listen = ""
[vehicle]
file = ""
[link]
url = "udpout:127.0.0.1:{port}"
[journal]
folder = "{state}"
[recording]
size = {size}
rate = {rate}
[live]
listen = "{live}"
[words]
grass = 1.0
trail = 1.0
bush = -1.0
"""
_NAMES = {
    "companion.vision": "vision",
    "companion.observers.recording": "recorder",
    "companion.observers.live": "live",
}


class Processes:
    """Reads the CPU time, the memory and the written bytes of a companion and its processes."""

    def __init__(self, main: int) -> None:
        self._main = main

    def each(self) -> dict[str, int]:
        """Returns the process ids by name."""
        found = {"supervisor": self._main}
        for child, command in children(self._main).items():
            found |= {name: child for part, name in _NAMES.items() if part in command}
        return found

    def cpu(self) -> dict[str, float]:
        """Returns seconds of CPU by name."""
        tick = os.sysconf("SC_CLK_TCK")
        found = {}
        for name, pid in self.each().items():
            fields = Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()
            found[name] = (int(fields[11]) + int(fields[12])) / tick
        return found

    def of(self, name: str, file: str, key: str) -> int:
        """Returns a number of /proc/PID/`file`, 0 without such a process."""
        pid = self.each().get(name)
        if pid is None:
            return 0
        lines = (line.split() for line in Path(f"/proc/{pid}/{file}").read_text().splitlines())
        return next((int(line[1]) for line in lines if line[0] == key), 0)


class _Operator:
    """Sets a word again and again, and takes the times until it is acknowledged."""

    def __init__(self, port: int, packing: float = 0.0) -> None:
        """packing: s between two incident files that it has packed, 0: none."""
        random = Random(1)
        self._client = OperatorClient(lambda: random.randrange(1, 1 << 32))
        self._runner = Runner(open_connection(f"udpin:127.0.0.1:{port}"), self._client)
        self._pending: Pending | None = None
        self._asked_at = 0.0
        self._count = 0
        self._packing = packing
        self._packed_at = 0.0
        self.times: list[float] = []

    def step(self, now: float) -> None:
        """Sends what is due, and takes what came."""
        self._runner.step(now)
        for _ in self._client.events():
            pass
        pending = self._pending
        if pending is not None and pending.acknowledgement is not None and pending.settled:
            self.times.append(now - self._asked_at)
            self._pending = None
        if self._packing and _SYSTEM in self._client.rovers and now - self._packed_at >= self._packing:
            self._client.answer(_SYSTEM, Answer(0, Motion.NONE, (PackIncident(0),)), now)
            self._packed_at = now
        if self._pending is None and _SYSTEM in self._client.rovers and now - self._asked_at >= _EVERY:
            self._count += 1
            word = SetWord("grass", 1.0 - 0.01 * (self._count % 2))
            self._pending = self._client.answer(_SYSTEM, Answer(0, Motion.NONE, (word,)), now)
            self._asked_at = now

    def close(self) -> None:
        """Closes the link."""
        self._runner.close()


class _Viewers:
    """Watches a live view with all topics, in a process of its own, and counts what comes."""

    def __init__(self, url: str, count: int) -> None:
        self._counts = multiprocessing.get_context("spawn").Array("Q", 2)
        self._process = multiprocessing.get_context("spawn").Process(
            target=_view, args=(url, count, self._counts), daemon=True
        )
        self._process.start()

    @property
    def seen(self) -> tuple[int, int]:
        """Messages and bytes that came, to all viewers together."""
        return self._counts[0], self._counts[1]

    def close(self) -> None:
        """Ends it. May be called repeatedly."""
        self._process.kill()
        self._process.join()


def _view(url: str, count: int, counts: Any) -> None:
    asyncio.run(_view_all(url, count, counts))


async def _view_all(url: str, count: int, counts: Any) -> None:
    await asyncio.gather(*(_view_one(url, counts) for _ in range(count)))


async def _view_one(url: str, counts: Any) -> None:
    from websockets import Subprotocol
    from websockets.asyncio.client import connect

    async with connect(url, subprotocols=[Subprotocol("foxglove.sdk.v1")], max_size=None) as viewer:
        await viewer.recv()
        advertised = json.loads(await viewer.recv())["channels"]
        wanted = [{"id": one["id"], "channelId": one["id"]} for one in advertised]
        await viewer.send(json.dumps({"op": "subscribe", "subscriptions": wanted}))
        async for said in viewer:
            counts[0] += 1
            counts[1] += len(said)


def measure(
    frames: Path,
    camera: float,
    rate: float,
    seconds: float,
    folder: Path,
    packing: float = 0.0,
    viewers: int | None = None,
) -> dict[str, Any]:
    """Measures one run.

    rate: recorded frames/s, 0: no recorder. packing: of `_Operator`. viewers: of a live view in its place.
    """
    port = 20_000 + os.getpid() % 20_000
    state = folder / "state"
    live = f"127.0.0.1:{port + 1}" if rate and viewers is not None else ""
    size = 1000 if rate and viewers is None else 0
    values = {"frames": frames, "camera": camera, "port": port, "state": state, "live": live, "size": size}
    config = folder / "companion.toml"
    config.write_text(_CONFIG.format(**values, rate=rate or 1.0))
    process = subprocess.Popen(
        [sys.executable, "-m", "companion", "run", str(config)],
        cwd=ROOT,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        stderr=subprocess.DEVNULL,
    )
    operator, watching = _Operator(port, packing), None
    try:
        processes = Processes(process.pid)
        _step(operator, lambda: bool(read_status(state)[1].get("frames")), _READY_WITHIN)
        if live and viewers:
            _step(operator, lambda: bool(read_status(state)[1]["live"]["url"]), _READY_WITHIN)
            watching = _Viewers(f"ws://{live}", viewers)
            _step(operator, lambda: bool(read_status(state)[1]["live"]["clients"] == viewers), _READY_WITHIN)
        _step(operator, lambda: False, _SETTLED)
        operator.times.clear()
        before, cpu, began = read_status(state)[1], processes.cpu(), time.monotonic()
        wrote, waited = processes.of("recorder", "io", "write_bytes:"), _pressure()
        seen = watching.seen if watching is not None else (0, 0)
        _step(operator, lambda: False, seconds)
        shown = watching.seen if watching is not None else (0, 0)
        after, took = read_status(state)[1], time.monotonic() - began
        used = {name: round(100 * (spent - cpu[name]) / took, 2) for name, spent in processes.cpu().items()}
        wrote = processes.of("recorder", "io", "write_bytes:") - wrote
        waited = {name: round(100 * (now - waited[name]) / took, 1) for name, now in _pressure().items()}
        memory = processes.of("live" if live else "recorder", "smaps_rollup", "Pss:")
        if watching is not None:
            watching.close()
        process.send_signal(signal.SIGTERM)
        process.wait(20.0)
    finally:
        operator.close()
        if watching is not None:
            watching.close()
        process.kill()
        process.wait()
    recent = [(judged - captured) * 1e3 for _, captured, judged in read_status(state)[1]["recent"]]
    recorded, packed = after["recording"], kept(state)
    return {
        "rate": rate,
        "packing": packing,
        "packed": {
            "n": packed[0].number if packed else 0,
            "MB": round(max((one.size for one in packed), default=0) / 1e6, 2),
            "short_kB": round(max((one.short for one in packed), default=0) / 1e3, 1),
        },
        "judged_per_s": round((after["frames"] - before["frames"]) / took, 2),
        "latency_ms": {"p50": at(recent, 0.5), "p99": at(recent, 0.99)},
        "acknowledged_ms": {
            "n": len(operator.times),
            "p50": round(1e3 * median(operator.times), 1),
            "max": round(1e3 * max(operator.times), 1),
        },
        "cpu_percent": used,
        "kB_per_s": round((recorded["bytes"] - before["recording"]["bytes"]) / took / 1e3, 1),
        "written_to_disk_MB_per_h": round(wrote / took * 3600 / 1e6),
        "process_MB": round(memory / 1e3, 1),
        "shown_messages_per_s": round((shown[0] - seen[0]) / took, 1),
        "shown_kB_per_s": round((shown[1] - seen[1]) / took / 1e3, 1),
        "lost": recorded["lost"] + after["live"]["lost"],
        "left_out": recorded["left_out"],
        "pressure_percent": waited,
    }


def _pressure() -> dict[str, float]:
    """Returns the seconds for which anything on this computer waited for CPU or disk, whoever uses them."""
    found = {}
    for name in ("cpu", "io"):
        text = Path(f"/proc/pressure/{name}").read_text(encoding="utf-8")
        found[name] = int(text.split("total=")[1].split()[0]) / 1e6
    return found


def medians(runs: list[dict[str, Any]]) -> list[dict[str, Any]]:
    """Returns the median of each figure over the runs of a kind: other programs disturb single ones."""
    found = []
    for kind in dict.fromkeys((run["rate"], run["packing"]) for run in runs):
        own = [run for run in runs if (run["rate"], run["packing"]) == kind]
        found.append({key: _median([run[key] for run in own]) for key in own[0]} | {"runs": len(own)})
    return found


def _median(values: list[Any]) -> Any:
    if isinstance(values[0], dict):
        return {key: _median([one[key] for one in values]) for key in values[0]}
    return round(median(values), 2)


def _step(operator: _Operator, ends: Any, within: float) -> None:
    until = time.monotonic() + within
    while time.monotonic() < until and not ends():
        operator.step(time.monotonic())
        time.sleep(0.005)


def main() -> int:
    """Measures, and prints one line a run; the last line is one JSON object, with the medians."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--frames", type=Path, required=True)
    parser.add_argument("--seconds", type=float, default=60.0)
    parser.add_argument("--rates", default="0,1,10")
    parser.add_argument("--camera", type=float, default=10.0)
    parser.add_argument("--rounds", type=int, default=1)
    parser.add_argument("--packing", default="0")
    parser.add_argument("--viewers", type=int, help="of a live view, in place of a recorder")
    given = parser.parse_args()
    runs = []
    for _ in range(given.rounds):
        for rate, packing in product(*(map(float, one.split(",")) for one in (given.rates, given.packing))):
            with tempfile.TemporaryDirectory(prefix="recording-", dir=ROOT) as folder:
                arguments = given.frames.resolve(), given.camera, rate, given.seconds, Path(folder)
                runs.append(measure(*arguments, packing, given.viewers))
                print(json.dumps(runs[-1]), flush=True)
    print(json.dumps({"commit": commit_of(ROOT), "medians": medians(runs)}))
    return 0


if __name__ == "__main__":
    sys.exit(main())
