"""Serves stamped pictures as H.264 over RTSP on 127.0.0.1: `rtsp_server.py PORT [WIDTH HEIGHT RATE]`.

It runs under /usr/bin/python3 and needs Debian's gir1.2-gst-rtsp-server-1.0 and gstreamer1.0-plugins-ugly.
It prints the port once it listens; port 0 takes a free one. /trail is the stream. With USER_NAME and PASSWORD
in the environment it asks for them.
"""

from __future__ import annotations

import os
import sys
import time
from typing import Any

import gi
from stamps import stamped

gi.require_version("Gst", "1.0")
gi.require_version("GstRtspServer", "1.0")
from gi.repository import GLib, Gst, GstRtspServer  # noqa: E402


class Factory(GstRtspServer.RTSPMediaFactory):
    """Makes a pipeline whose pictures this program draws when they are due."""

    def __init__(self, width: int, height: int, rate: int) -> None:
        super().__init__()
        self._size, self._rate = (width, height), rate
        self.set_launch(
            "( appsrc name=pictures is-live=true do-timestamp=true format=time "
            f"caps=video/x-raw,format=GRAY8,width={width},height={height},framerate={rate}/1 "
            "! videoconvert ! video/x-raw,format=I420 ! x264enc tune=zerolatency speed-preset=ultrafast "
            f"bitrate=1500 key-int-max={rate} ! rtph264pay name=pay0 pt=96 config-interval=1 )"
        )
        self.set_shared(True)

    def feed(self, _: Any, media: Any) -> None:
        source = media.get_element().get_child_by_name("pictures")
        GLib.timeout_add(1000 // self._rate, self._push, source)

    def _push(self, source: Any) -> bool:
        picture = stamped(*self._size, time.monotonic())
        return bool(source.emit("push-buffer", Gst.Buffer.new_wrapped(picture)) == Gst.FlowReturn.OK)


def main(port: str, width: str = "640", height: str = "480", rate: str = "15") -> None:
    """Serve rtsp://127.0.0.1:PORT/trail until killed."""
    Gst.init(None)
    server = GstRtspServer.RTSPServer()
    server.set_address("127.0.0.1")
    server.set_service(port)
    factory = Factory(int(width), int(height), int(rate))
    factory.connect("media-configure", factory.feed)
    if "USER_NAME" in os.environ:
        auth = GstRtspServer.RTSPAuth()
        token = GstRtspServer.RTSPToken()
        token.set_string("media.factory.role", "user")
        login = GstRtspServer.RTSPAuth.make_basic(os.environ["USER_NAME"], os.environ["PASSWORD"])
        auth.add_basic(login, token)
        server.set_auth(auth)
        allowed = "user, media.factory.access=(boolean)true, media.factory.construct=(boolean)true"
        factory.add_role_from_structure(Gst.Structure.from_string(allowed)[0])
    server.get_mount_points().add_factory("/trail", factory)
    if not server.attach(None):
        sys.exit(f"port {port} is in use")
    print(server.get_bound_port(), flush=True)
    GLib.MainLoop().run()


if __name__ == "__main__":
    main(*sys.argv[1:])
