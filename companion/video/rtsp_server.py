"""The video process: serves the newest picture as an H.264 stream by RTSP.

It is run as a script by the system's Python (`[video] python`), because GStreamer's bindings come with the
system and not with pip. So it imports nothing of this project. It is given JPEGs and decodes, repeats and
encodes them at its own rate, only while somebody watches.

Each message is one datagram (SOCK_SEQPACKET). To it: b"c" and a JSON object (host, port, path, rate, encoder)
once; then b"p", the id of a frame (u32) and its JPEG. From it, four times a second: `REPORT`.
"""

from __future__ import annotations

import ctypes
import json
import os
import signal
import socket
import struct
import sys
import time
from typing import Any, NoReturn

REPORT = struct.Struct("<HIB")
"""The port, the id of the frame that is shown, and whether anybody watches (0 or 1)."""
LARGEST = 192 << 10
"""Bytes of a message."""
STALE_AFTER = 2.0
"""Seconds without a new picture after which the video says so."""
_REPORT_MS = 250
_SESSION_TIMEOUT = 10
"""Seconds after which a viewer that is silent counts as gone."""
_MOST_VIEWERS = 4
_WAITING = 2 << 20
"""Bytes of pictures that may wait for the encoder."""
_MOST_MEMORY = 1 << 30
_SETUP_WITHIN = 10.0
_NICENESS, _FIRST_OUT = 10, 950
_DEATH_SIGNAL = 1

PIPELINE = (
    "( appsrc name=source is-live=true do-timestamp=true format=time caps=image/jpeg,framerate={rate}/1"
    " ! jpegdec ! textoverlay name=note silent=true valignment=center font-desc=Sans,28 ! videoconvert"
    " ! video/x-raw,format=I420 ! {encoder}"
    " ! rtph264pay name=pay0 pt=96 config-interval=1 )"
)


class Stream:
    """One stream for all viewers. picture: the newest one, with its frame's id."""

    def __init__(self, channel: socket.socket, setup: dict[str, Any]) -> None:
        """Listen on the port. Raises OSError when another program has it."""
        from gi.repository import Gst, GstRtspServer

        self._gst = Gst
        self._channel = channel
        self._source: Any = None
        self._note: Any = None
        self._playing = False
        self._picture: tuple[int, bytes] | None = None
        self._shown = 0
        self._picture_at = time.monotonic()
        self._server = GstRtspServer.RTSPServer()
        self._server.set_address(setup["host"])
        self._server.set_service(str(setup["port"]))
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
            frame, jpeg = self._picture
            source.emit("push-buffer", self._gst.Buffer.new_wrapped(jpeg))
            self._shown = 0 if stale else frame
        return True

    def report(self) -> bool:
        """Tell the supervisor that this process lives, and what is shown."""
        self._pool.cleanup()
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

    def _connected(self, _server: Any, client: Any) -> None:
        client.connect("new-session", lambda _client, session: session.set_timeout(_SESSION_TIMEOUT))

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


def main(descriptor: int, parent: int) -> NoReturn:
    """Serve until the supervisor, process `parent`, is gone. descriptor: the channel's socket."""
    ctypes.CDLL(None).prctl(_DEATH_SIGNAL, signal.SIGKILL)
    if os.getppid() != parent:
        os._exit(0)
    os.nice(_NICENESS)
    try:
        with open("/proc/self/oom_score_adj", "w", encoding="ascii") as file:
            file.write(str(_FIRST_OUT))
    except OSError:
        pass
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, signal.SIG_IGN)
    channel = socket.socket(fileno=descriptor)
    channel.settimeout(_SETUP_WITHIN)
    packed = channel.recv(LARGEST)
    if packed[:1] != b"c":
        sys.exit("the first message is no setup")
    channel.settimeout(0)
    import gi

    for name in ("Gst", "GstApp", "GstRtsp", "GstRtspServer"):
        gi.require_version(name, "1.0")
    from gi.repository import GLib, Gst

    Gst.init(None)
    setup = json.loads(packed[1:])
    try:
        stream = Stream(channel, setup)
    except OSError as error:
        sys.exit(str(error))
    GLib.io_add_watch(
        descriptor, GLib.PRIORITY_DEFAULT, GLib.IO_IN | GLib.IO_HUP, lambda *_: stream.receive()
    )
    GLib.timeout_add(round(1000 / setup["rate"]), stream.push)
    GLib.timeout_add(_REPORT_MS, stream.report)
    GLib.MainLoop().run()
    os._exit(1)


if __name__ == "__main__":
    main(int(sys.argv[1]), int(sys.argv[2]))
