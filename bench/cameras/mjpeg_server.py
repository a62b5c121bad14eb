"""Serves stamped pictures as MJPEG over HTTP on 127.0.0.1: `mjpeg_server.py PORT [WIDTH HEIGHT RATE]`.

It prints the port once it listens. /trail is the stream; everything else is 404. With USER_NAME and PASSWORD
in the environment it asks for them.
"""

from __future__ import annotations

import base64
import contextlib
import os
import sys
import time
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer

import cv2
import numpy as np

from bench.cameras.stamps import stamped


def main(port: str, width: str = "640", height: str = "480", rate: str = "15") -> None:
    """Serve http://127.0.0.1:PORT/trail until killed."""
    size = int(width), int(height)
    user = os.environ.get("USER_NAME")
    wanted = user and "Basic " + base64.b64encode(f"{user}:{os.environ['PASSWORD']}".encode()).decode()

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            code = 200 if self.path == "/trail" else 404
            if wanted and self.headers["Authorization"] != wanted:
                code = 401
            self.send_response(code)
            if code == 401:
                self.send_header("WWW-Authenticate", 'Basic realm="camera"')
            self.send_header("Content-Type", "multipart/x-mixed-replace; boundary=frame")
            self.end_headers()
            due = time.monotonic()
            while code == 200:
                picture = np.frombuffer(stamped(*size, time.monotonic()), np.uint8).reshape(size[::-1])
                jpeg = cv2.imencode(".jpg", picture)[1].tobytes()
                head = f"--frame\r\nContent-Type: image/jpeg\r\nContent-Length: {len(jpeg)}\r\n\r\n"
                self.wfile.write(head.encode() + jpeg + b"\r\n")
                due = max(due + 1.0 / float(rate), time.monotonic())
                time.sleep(max(0.0, due - time.monotonic()))

        def log_message(self, *_: object) -> None:
            """Say nothing."""

        def handle(self) -> None:
            with contextlib.suppress(OSError):  # the reader is gone
                super().handle()

    ThreadingHTTPServer.daemon_threads = True
    server = ThreadingHTTPServer(("127.0.0.1", int(port)), Handler)
    print(server.server_port, flush=True)
    server.serve_forever()


if __name__ == "__main__":
    main(*sys.argv[1:])
