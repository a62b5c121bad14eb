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

from bench.cameras.stamps import stamped

gi.require_version("Gst", "1.0")
gi.require_version("GstRtspServer", "1.0")
from gi.repository import GLib, Gst, GstRtspServer  # noqa: E402


def feed(media: Any, width: int, height: int, rate: int) -> None:
    """Give a stream's pipeline its pictures when they are due."""
    source = media.get_element().get_child_by_name("pictures")

    def push() -> bool:
        picture = Gst.Buffer.new_wrapped(stamped(width, height, time.monotonic()))
        return bool(source.emit("push-buffer", picture) == Gst.FlowReturn.OK)

    GLib.timeout_add(1000 // rate, push)


def main(port: str, width: str = "640", height: str = "480", rate: str = "15") -> None:
    """Serve rtsp://127.0.0.1:PORT/trail until killed."""
    Gst.init(None)
    server = GstRtspServer.RTSPServer()
    server.set_address("127.0.0.1")
    server.set_service(port)
    factory = GstRtspServer.RTSPMediaFactory()
    factory.set_launch(
        "( appsrc name=pictures is-live=true do-timestamp=true format=time "
        f"caps=video/x-raw,format=GRAY8,width={width},height={height},framerate={rate}/1 "
        "! videoconvert ! video/x-raw,format=I420 ! x264enc tune=zerolatency speed-preset=ultrafast "
        f"bitrate=1500 key-int-max={rate} ! rtph264pay name=pay0 pt=96 config-interval=1 )"
    )
    factory.set_shared(True)
    size = int(width), int(height), int(rate)
    factory.connect("media-configure", lambda _, media: feed(media, *size))
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
