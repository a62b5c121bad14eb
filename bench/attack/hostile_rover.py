"""Plays a rover that wants its operator's station to hang, to fill its memory, or to show what it is told."""

from __future__ import annotations

import contextlib
import io
import itertools
import json
import random
import socket
import threading
import time
import zipfile
from collections import deque
from collections.abc import Iterator, Mapping
from dataclasses import replace
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from bench.attack.hostile_camera import jpeg_of
from bench.console.latency import call_of
from companion.wire import ids
from companion.wire.ftp import MAX_DATA, FtpPayload, Opcode

SYSTEM = 1
EVIL = "\x1b]0;gotcha\a\x1b[2J\u009b31m<script>alert(1)</script>\"'>&\r\n\u202e"
INCIDENT = "0001-C1"
_FRAMES, _A_STEP, _FLOOD_A_STEP = 4000, 4, 16
"""Of what is sent in each step, some 2 ms: a station reads 64 frames in 20 ms, and loses others."""
_STATIONS = 255, 190


class HostileRover:
    """Talks to the station at `address` whenever `step` is called. floods: with all that it can say."""

    def __init__(self, address: tuple[str, int]) -> None:
        self._air = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._air.settimeout(0)
        self._air.connect(address)
        self._encoder = mavlink.MAVLink(None, SYSTEM, ids.COMPONENT_ID)
        self._parser = mavlink.MAVLink(None)
        self._parser.robust_parsing = True
        self._out: deque[bytes] = deque()
        self._flood = itertools.cycle(list(_flood()))
        self.floods = False
        self._files = _files()
        self._opened, self._speaks_at = b"", 0.0
        self.asked: set[str] = set()
        """The paths that the station asked for."""

    def step(self) -> None:
        """Say what is due, and answer."""
        if time.monotonic() >= self._speaks_at:
            self._speaks_at = time.monotonic() + 0.5
            call = replace(call_of(1, ids.Stage.OPEN), picture="/calls/1.jpg").pack()
            mode = ids.heartbeat_mode(ids.State.CALLING, 1, ids.Policy.HOLD)
            self._say(mavlink.MAVLink_heartbeat_message(18, 8, 0, mode, 4, 3))
            self._say(
                mavlink.MAVLink_tunnel_message(0, 0, ids.TUNNEL_CALL, len(call), call.ljust(128, b"\0"))
            )
        with contextlib.suppress(BlockingIOError, ConnectionRefusedError):
            while True:
                for message in self._parser.parse_buffer(self._air.recv(4096)) or []:
                    if message.get_type() == "FILE_TRANSFER_PROTOCOL" and message.target_system == SYSTEM:
                        self._serve(FtpPayload.unpack(bytes(message.payload)))
        flood = itertools.islice(self._flood, _FLOOD_A_STEP if self.floods else 0)
        said = (self._out.popleft() for _ in range(min(_A_STEP, len(self._out))))
        with contextlib.suppress(OSError):
            for frame in (*said, *flood):
                self._air.send(frame)

    def close(self) -> None:
        """End it."""
        self._air.close()

    def _say(self, message: Any) -> None:
        self._out.append(bytes(message.pack(self._encoder)))
        self._encoder.seq = (self._encoder.seq + 1) % 256

    def _serve(self, asked: FtpPayload) -> None:
        replies = [asked.ack()]
        if asked.opcode == Opcode.LIST_DIRECTORY:
            names = (b"F%d.json\t9" % (asked.offset + number) for number in range(18))
            replies = [asked.ack(b"\0".join(names))]
        elif asked.opcode == Opcode.OPEN_FILE_RO:
            self.asked.add(path := asked.path())
            kind = path.rpartition(".")[2] if path.startswith("/calls/") else path
            self._opened = next(self._files.get(kind, iter(())), b"")
            replies = [asked.ack(len(self._opened).to_bytes(4, "little"))]
        elif asked.opcode in (Opcode.READ_FILE, Opcode.BURST_READ_FILE):
            burst = asked.opcode == Opcode.BURST_READ_FILE
            end = len(self._opened) if burst else asked.offset + asked.size
            starts = range(asked.offset, end, MAX_DATA)
            replies = [asked.ack(self._opened[at : min(end, at + MAX_DATA)], offset=at) for at in starts]
            replies[-1:] = [replace(one, burst_complete=burst) for one in replies[-1:]]
        for one in replies:
            self._say(mavlink.MAVLink_file_transfer_protocol_message(0, *_STATIONS, one.pack()))


def _files() -> Mapping[str, Iterator[bytes]]:
    """Return what is served by turns: by path, and of calls by the ending of their files."""
    text, names = 20 * EVIL, {f"{EVIL} {number}": 0.5 for number in range(300)}
    call = {"id": 1, "frame_id": 1, "kind": "call", "stage": "open", "why": text, "picture": "/calls/1.jpg"}
    told = dict.fromkeys(("state", "hold_refused", "held_by", "model", "version"), text)
    state = {**told, "words": {"grass": 1.0, **names}, "given": names, "vocabulary": [*names], "open": call}
    answer = dict.fromkeys(("motion", "result", "text"), text) | {"operations": [text], "sender": [255, 190]}
    record = {**call, "words": text, "outcome": text, "answers": [answer] * 20, "large": "/calls/1-large.jpg"}
    checks = [{"check": text, "verdict": "fail", "text": text}] * 60
    packed = [{"name": INCIDENT, "bytes": 5e6, "short": 1e6, "note": text}] * 50
    jpeg = jpeg_of()
    shown = jpeg[:2] + b"\xff\xfe" + (2 + len(EVIL.encode())).to_bytes(2, "big") + EVIL.encode() + jpeg[2:]
    served = {
        "/state.json": [json.dumps(state).encode(), b"[" * 200_000, bytes(300_000), b'{"words":' * 20_000],
        "/check.json": [json.dumps({"checks": checks}).encode()],
        "json": [json.dumps(record).encode()],
        "jpg": [shown, b"\xff\xd8" + b"\xff\xe0\0\2" * 50_000, b"\xff" * 200_000],
        "/incidents.json": [json.dumps({"packed": packed, "failed": {"what": "C1", "why": text}}).encode()],
    }
    return {path: itertools.cycle(contents) for path, contents in served.items()}


class HostilePage(ThreadingHTTPServer):
    """Serves a zip of so many members as an incident file at `url`, and one without end as the short file."""

    daemon_threads = True

    def __init__(self, members: int) -> None:
        super().__init__(("127.0.0.1", 0), _Handler)
        self.url, packed = f"http://127.0.0.1:{self.server_port}", io.BytesIO()
        with zipfile.ZipFile(packed, "w") as archive:
            for number in range(members):
                archive.writestr(str(number), b"")
        self.zip = packed.getvalue()
        threading.Thread(target=self.serve_forever, daemon=True).start()

    def close(self) -> None:
        """End it."""
        self.shutdown()
        self.server_close()


class _Handler(BaseHTTPRequestHandler):
    server: HostilePage

    def do_GET(self) -> None:
        self.send_response(200)
        self.end_headers()
        endless = self.path.endswith("-short.zip")
        for piece in itertools.repeat(bytes(1 << 16)) if endless else (self.server.zip,):
            self.wfile.write(piece)

    def log_message(self, *_: object) -> None:
        """Say nothing."""

    def handle(self) -> None:
        with contextlib.suppress(OSError):  # the reader is gone
            super().handle()


def _flood() -> Iterator[bytes]:
    """Yield calls without end, of many rovers, and whatever else a station reads, wrong in each way."""
    chance, evil = random.Random(5), EVIL.encode()
    for number in range(_FRAMES):
        call = replace(call_of(1 + number, ids.Stage.OPEN), frame_id=number, picture=EVIL[:20]).pack()
        wrong, kind = chance.randbytes(128), chance.choice((ids.TUNNEL_SUMMARY, ids.TUNNEL_CALL))
        said = (
            mavlink.MAVLink_tunnel_message(0, 0, ids.TUNNEL_CALL, len(call), call.ljust(128, b"\0")),
            mavlink.MAVLink_heartbeat_message(18, 8, 0, chance.getrandbits(32), 4, 3),
            mavlink.MAVLink_statustext_message(number % 8, b"C%d " % number + evil[:42]),
            mavlink.MAVLink_param_value_message(b"AT_W_" + evil[:11], 0.5, 9, 0xFFFF, number),
            mavlink.MAVLink_tunnel_message(0, 0, kind, number % 129, wrong),
            mavlink.MAVLink_file_transfer_protocol_message(0, *_STATIONS, wrong + wrong[:123]),
        )[number % 6]
        component = ids.AUTOPILOT_COMPONENT_ID if number % 12 == 2 else ids.COMPONENT_ID
        yield bytes(said.pack(mavlink.MAVLink(None, SYSTEM + number // 6 % 40, component)))
