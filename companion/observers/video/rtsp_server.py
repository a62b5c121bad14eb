"""The video process: serves the newest picture as an H.264 stream by RTSP.

It is run as a script by the system's Python (`[video] python`), because GStreamer's bindings come with the
system and not with pip. So it imports nothing of this project. It is given JPEGs and decodes, repeats and
encodes them at its own rate, only while somebody watches.

Each message is one datagram (SOCK_SEQPACKET). To it: b"c" and a JSON object (host, port, path, rate, encoder,
cache: a folder for GStreamer's list of elements) once; then b"p", the number of a picture (u32, 0: a live
one) and its JPEG. From it, four times a second: `REPORT`; or once, one byte: why it cannot run.
"""

from __future__ import annotations

import contextlib
import ctypes
import json
import os
import resource
import signal
import socket
import struct
import sys
import time
from typing import Any, NoReturn

REPORT = struct.Struct("<HIB")
"""The port, the number of the picture that is shown, and whether anybody watches (0 or 1)."""
LARGEST = 192 << 10
"""Bytes of a message."""
STALE_AFTER = 2.0
"""Seconds without a new picture after which the video says so."""
_REPORT_MS = 250
_SESSION_TIMEOUT = 10
"""Seconds after which a viewer that is silent counts as gone."""
_MOST_VIEWERS = 4
_BACKLOG = 64
_MOST_UNUSED, _UNUSED_FOR = 16, 10.0
"""Connections that asked for no video yet, and the seconds after which they are closed."""
_WAITING = 2 << 20
"""Bytes of pictures that may wait for the encoder."""
_MOST_MEMORY = 1 << 30
_SETUP_WITHIN = 10.0
_NICENESS, _FIRST_OUT = 10, 950
PORT_TAKEN, NO_GSTREAMER = b"t", b"g"
"""Why it cannot run."""
_DEATH_SIGNAL = 1

BINDINGS = ("Gst", "GstApp", "GstRtsp", "GstRtspServer")
"""GStreamer's bindings that it imports."""
PIPELINE = (
    "( appsrc name=source is-live=true do-timestamp=true format=time caps=image/jpeg,framerate={rate}/1"
    " ! jpegdec ! textoverlay name=note silent=true valignment=center font-desc=Sans,28 ! videoconvert"
    " ! video/x-raw,format=I420 ! {encoder}"
    " ! rtph264pay name=pay0 pt=96 config-interval=1 )"
)


def elements(encoder: str) -> list[str]:
    """Name GStreamer's elements that the video needs. encoder: the element that encodes, with properties."""
    parts = [part.split()[0] for part in PIPELINE.format(rate=1, encoder=encoder).strip("() ").split("!")]
    return [part for part in parts if "/" not in part]


class _Stream:
    """One stream for all viewers."""

    def __init__(self, channel: socket.socket, setup: dict[str, Any]) -> None:
        """Listen on the port. Raises OSError when another program has it."""
        from gi.repository import Gst, GstRtspServer

        self._gst = Gst
        self._channel = channel
        self._source: Any = None
        self._note: Any = None
        self._playing = False
        self._picture: tuple[int, bytes] | None = None
        """The newest one, with its number."""
        self._shown = 0
        self._connections: dict[Any, float] = {}
        """When each was made."""
        self._picture_at = time.monotonic()
        self._server = GstRtspServer.RTSPServer()
        self._server.set_address(setup["host"])
        self._server.set_service(str(setup["port"]))
        self._server.set_backlog(_BACKLOG)
        factory = GstRtspServer.RTSPMediaFactory()
        factory.set_launch(PIPELINE.format(rate=setup["rate"], encoder=setup["encoder"]))
        factory.set_shared(True)
        factory.connect("media-configure", self._configure)
        self._server.get_mount_points().add_factory(setup["path"], factory)
        self._pool = self._server.get_session_pool()
        self._pool.set_max_sessions(_MOST_VIEWERS)
        self._server.connect("client-connected", self._connected)
        if self._server.attach(None) == 0:
            raise OSError(f"port {setup['port']} of {setup['host']} cannot be had")

    def receive(self) -> bool:
        """Take what the supervisor sent. Ends the process when the supervisor is gone."""
        try:
            packed = self._channel.recv(LARGEST)
        except (BlockingIOError, InterruptedError):
            return True
        except OSError:
            packed = b""
        if not packed:
            os._exit(0)
        if packed[:1] == b"p" and len(packed) > 5:
            self._picture = int.from_bytes(packed[1:5], "little"), packed[5:]
            self._picture_at = time.monotonic()
        return True

    def push(self) -> bool:
        """Give the newest picture to the encoder, if anybody watches and the encoder keeps up."""
        source = self._source
        if source is None or self._picture is None:
            return True
        silent = time.monotonic() - self._picture_at
        stale = silent > STALE_AFTER
        if stale:
            self._note.set_property("text", f"NO NEW PICTURE FOR {silent:.0f} s")
        self._note.set_property("silent", not stale)
        if source.get_property("current-level-bytes") < _WAITING:
            number, jpeg = self._picture
            source.emit("push-buffer", self._gst.Buffer.new_wrapped(jpeg))
            self._shown = 0 if stale else number
        return True

    def report(self) -> bool:
        """Tell the supervisor that this process lives, and what is shown."""
        self._pool.cleanup()
        self._close_unused()
        shown = self._shown if self._playing else 0
        # A viewer is told how the video looks only once there is a picture of it.
        watched = self._source is not None
        try:
            self._channel.send(REPORT.pack(self._server.get_bound_port(), shown, watched))
        except (BlockingIOError, InterruptedError):
            pass
        except OSError:
            os._exit(0)
        return True

    def _close_unused(self) -> None:
        now = time.monotonic()
        connections = list(self._connections.items())  # oldest first
        unused = [(client, at) for client, at in connections if not client.session_filter(None)]
        for place, (client, at) in enumerate(reversed(unused)):
            if place >= _MOST_UNUSED or now - at > _UNUSED_FOR:
                client.close()

    def _connected(self, _server: Any, client: Any) -> None:
        self._connections[client] = time.monotonic()
        client.connect("new-session", self._joined)
        client.connect("play-request", self._played)
        client.connect("closed", self._left)

    def _joined(self, client: Any, session: Any) -> None:
        session.set_timeout(_SESSION_TIMEOUT)
        # A viewer that lost its connection may come again at once.
        client.connect("closed", lambda _client: self._pool.remove(session))

    def _left(self, client: Any) -> None:
        self._connections.pop(client, None)

    def _played(self, _client: Any, _context: Any) -> None:
        """Have a whole picture encoded: a new viewer sees nothing before the next one."""
        gst, source = self._gst, self._source
        if source is not None:
            wanted = gst.Structure.new_from_string("GstForceKeyUnit, all-headers=(boolean)true")
            source.send_event(gst.Event.new_custom(gst.EventType.CUSTOM_DOWNSTREAM, wanted))

    def _configure(self, _factory: Any, media: Any) -> None:
        element = media.get_element()
        source, note = element.get_by_name_recurse_up("source"), element.get_by_name_recurse_up("note")
        self._source, self._note, self._shown, self._playing = source, note, 0, False
        media.connect("new-state", self._changed)
        media.connect("unprepared", self._ended, source)

    def _changed(self, _media: Any, state: int) -> None:
        self._playing = state == int(self._gst.State.PLAYING)

    def _ended(self, _media: Any, source: Any) -> None:
        if self._source is source:
            self._source, self._note, self._playing, self._shown = None, None, False, 0


def _give_up(channel: socket.socket, why: bytes) -> NoReturn:
    """Say why it cannot run, and end once the supervisor has heard it."""
    channel.settimeout(_SETUP_WITHIN)
    with contextlib.suppress(OSError):
        channel.send(why)
        while channel.recv(LARGEST):
            pass
    sys.exit(1)


def main(descriptor: int, parent: int) -> NoReturn:
    """Serve until the supervisor is gone. descriptor: the channel's socket.

    parent: the supervisor's process id, 0 where systemd started this process.
    """
    if parent:
        ctypes.CDLL(None).prctl(_DEATH_SIGNAL, signal.SIGKILL)
        if os.getppid() != parent:
            os._exit(0)
    os.nice(_NICENESS)
    try:
        with open("/proc/self/oom_score_adj", "w", encoding="ascii") as file:
            file.write(str(_FIRST_OUT))
    except OSError:
        pass
    with contextlib.suppress(OSError, ValueError):  # this computer's limit is lower
        resource.setrlimit(resource.RLIMIT_DATA, (_MOST_MEMORY, _MOST_MEMORY))
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)
    channel = socket.socket(fileno=descriptor)
    channel.settimeout(_SETUP_WITHIN)
    packed = channel.recv(LARGEST)
    if packed[:1] != b"c":
        sys.exit("the first message is no setup")
    setup = json.loads(packed[1:])
    # ORC compiles code while it runs, which the service forbids; without, it takes code made in advance.
    os.environ["ORC_CODE"] = "backup"
    cache = os.environ.get("CACHE_DIRECTORY", setup["cache"])
    os.environ["GST_REGISTRY"] = os.path.join(cache, "gstreamer-registry.bin")
    try:
        import gi

        for name in BINDINGS:
            gi.require_version(name, "1.0")
        from gi.repository import GLib, Gst
    except (ImportError, ValueError):
        _give_up(channel, NO_GSTREAMER)
    Gst.init(None)
    if any(Gst.ElementFactory.find(name) is None for name in elements(setup["encoder"])):
        _give_up(channel, NO_GSTREAMER)
    channel.settimeout(0)
    try:
        stream = _Stream(channel, setup)
    except OSError:
        _give_up(channel, PORT_TAKEN)
    GLib.io_add_watch(
        descriptor, GLib.PRIORITY_DEFAULT, GLib.IO_IN | GLib.IO_HUP, lambda *_: stream.receive()
    )
    GLib.timeout_add(round(1000 / setup["rate"]), stream.push)
    GLib.timeout_add(_REPORT_MS, stream.report)
    GLib.MainLoop().run()
    os._exit(1)


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))
