"""Sources with secrets in them, as the makers of cameras and the users of programs write them."""

from __future__ import annotations

from base64 import b64encode
from typing import NamedTuple

USER, PLAIN, MIXED, DIGITS = "operatrix", "correcthorse", "hunt3r!two", "48151623"
BASIC = b64encode(f"{USER}:{PLAIN}".encode()).decode()
ADDRESS = "ADDRESS"
"""Stands for host and port."""
SECRETS = (USER, PLAIN, MIXED, "hunt3r", DIGITS, BASIC)
"""What is looked for, of every form. The user's name is no secret by itself, and not shown either."""


class Form(NamedTuple):
    """A source. shown: what is shown of it; "" where it has no kind. valid: whether a file may name it."""

    source: str
    shown: str
    valid: bool = True


_GST = "pipe:gst-launch-1.0 -q"
_END = "! decodebin ! videoconvert ! video/x-raw,format=GRAY8,width=16,height=16 ! fdsink"
_RAW = "-f rawvideo -pix_fmt gray -"
_RTSP, _HTTP = "rtsp://ADDRESS/...", "http://ADDRESS/..."

URLS = {
    "user and password": Form(f"rtsp://{USER}:{PLAIN}@ADDRESS/Streaming/Channels/101", _RTSP),
    "password alone": Form(f"rtsp://:{MIXED}@ADDRESS/", _RTSP),
    "http": Form(f"http://{USER}:{MIXED}@ADDRESS/mjpg/video.mjpg", _HTTP),
    "https": Form(f"https://{USER}:{DIGITS}@ADDRESS/video", "https://ADDRESS/..."),
    "at in a password": Form(f"rtsp://{USER}:{MIXED}@{PLAIN}@ADDRESS/1", _RTSP),
    "slash in a password": Form(f"rtsp://{USER}:{MIXED}/{PLAIN}@ADDRESS/1", "rtsp:...", valid=False),
    "slash after digits": Form(f"rtsp://{USER}:481/{PLAIN}@ADDRESS/1", "rtsp:...", valid=False),
    "at and slash": Form(f"rtsp://{USER}:{MIXED}@{PLAIN}/{DIGITS}@ADDRESS/1", "rtsp:...", valid=False),
    "hash in a password": Form(f"http://{USER}:{MIXED}#{PLAIN}@ADDRESS/1", "http:...", valid=False),
    "question mark in a password": Form(f"rtsp://{USER}:{MIXED}?{PLAIN}@ADDRESS/1", "rtsp:...", valid=False),
    "percent": Form(f"rtsp://{USER}:%63orrect%68orse@ADDRESS/1", _RTSP),
    "in the path, with signs": Form(f"rtsp://ADDRESS/user={USER}&password={PLAIN}&channel=1", _RTSP),
    "in the path, with lines": Form(f"rtsp://ADDRESS/user={USER}_password={MIXED}_channel=1.sdp?real", _RTSP),
    "in the path, with an at": Form(f"rtsp://ADDRESS/user={USER}&password={MIXED}@{PLAIN}", _RTSP),
    "in the path, bare": Form(f"rtsp://ADDRESS/{PLAIN}/1", _RTSP),
    "query auth": Form(f"rtsp://ADDRESS/cam/realmonitor?channel=1&authbasic={BASIC}", _RTSP),
    "query key": Form(f"http://ADDRESS/mjpeg?key={MIXED}", _HTTP),
    "query api_key": Form(f"http://ADDRESS/mjpeg?api_key={PLAIN}", _HTTP),
    "query psw": Form(f"http://ADDRESS/stream.cgi?usr={USER}&psw={PLAIN}", _HTTP),
    "query pwd": Form(f"http://ADDRESS/CGIStream.cgi?cmd=GetMJStream&usr={USER}&pwd={MIXED}", _HTTP),
    "query loginpas": Form(f"http://ADDRESS/videostream.cgi?loginuse={USER}&loginpas={PLAIN}", _HTTP),
    "query token": Form(f"https://ADDRESS/live?token={MIXED}#{PLAIN}", "https://ADDRESS/..."),
    "query in capitals": Form(f"http://ADDRESS/live?PASSWORD={PLAIN}", _HTTP),
    "query without a name": Form(f"http://ADDRESS/live?{PLAIN}", _HTTP),
    "capitals": Form(f"RTSP://{USER}:{PLAIN}@ADDRESS/1", ""),
    "rtmp": Form(f"rtmp://{USER}:{PLAIN}@ADDRESS/live/{MIXED}", ""),
    "srt": Form(f"srt://ADDRESS?mode=caller&passphrase={PLAIN}", ""),
    "udp": Form(f"udp://{USER}:{MIXED}@ADDRESS", ""),
    "a slash too few": Form(f"rtsp:/{USER}:{PLAIN}@ADDRESS/1", "rtsp:/ADDRESS/...", valid=False),
    "no colon": Form(f"rtsp//{USER}:{PLAIN}@ADDRESS/1", ""),
    "no kind": Form(f"{USER}:{PLAIN}@ADDRESS/1", ""),
    "no kind, a key": Form(f"ADDRESS/user={USER}_password={PLAIN}", ""),
    "a wrong letter": Form(f"rstp://{USER}:{PLAIN}@ADDRESS/1", ""),
    "as a file": Form(f"video:rtsp://{USER}:{PLAIN}@ADDRESS/1", ""),
    "as a device": Form(f"v4l2:http://ADDRESS/?pwd={PLAIN}", ""),
}
PIPES = {
    "user-pw": Form(
        f"{_GST} rtspsrc location=rtsp://ADDRESS/1 user-id={USER} user-pw={PLAIN} {_END}",
        "pipe:gst-launch-1.0 rtspsrc ...",
    ),
    "user-pw in quotes": Form(
        f'{_GST} rtspsrc location="rtsp://ADDRESS/1" user-pw="{MIXED} {PLAIN}" {_END}',
        "pipe:gst-launch-1.0 rtspsrc ...",
    ),
    "location": Form(
        f"{_GST} uridecodebin uri=rtsp://{USER}:{PLAIN}@ADDRESS/1 {_END}",
        "pipe:gst-launch-1.0 uridecodebin ...",
    ),
    "extra-headers": Form(
        f"{_GST} souphttpsrc location=http://ADDRESS/ "
        f'extra-headers="h,Authorization=(string)\\"Basic {BASIC}\\"" {_END}',
        "pipe:gst-launch-1.0 souphttpsrc ...",
    ),
    "passphrase": Form(
        f"{_GST} srtsrc uri=srt://ADDRESS passphrase={PLAIN} {_END}", "pipe:gst-launch-1.0 srtsrc ..."
    ),
    "ffmpeg's url": Form(
        f"pipe:ffmpeg -v error -i rtsp://{USER}:{MIXED}@ADDRESS/1 {_RAW}", "pipe:ffmpeg ..."
    ),
    "ffmpeg's headers": Form(
        f'pipe:ffmpeg -headers "Authorization: Basic {BASIC}" -i http://ADDRESS/ {_RAW}', "pipe:ffmpeg ..."
    ),
    "ffmpeg's cookies": Form(
        f"pipe:/usr/local/../bin/env ffmpeg -cookies sid={PLAIN} -i http://ADDRESS/ {_RAW}", "pipe:env ..."
    ),
    "curl -u": Form(f"pipe:curl -s -u {USER}:{PLAIN} http://ADDRESS/raw", "pipe:curl ..."),
    "curl -u, joined": Form(f"pipe:curl -s -u{USER}:{MIXED} http://ADDRESS/raw", "pipe:curl ..."),
    "curl --user=": Form(f"pipe:curl --user={USER}:{DIGITS} http://ADDRESS/raw", "pipe:curl ..."),
    "curl -H Basic": Form(
        f'pipe:curl -s -H "Authorization: Basic {BASIC}" http://ADDRESS/raw', "pipe:curl ..."
    ),
    "curl -H Bearer": Form(f"pipe:curl -H 'Authorization: Bearer {PLAIN}' http://ADDRESS/", "pipe:curl ..."),
    "curl -H X-Api-Key": Form(f"pipe:curl -H X-Api-Key:{MIXED} http://ADDRESS/raw", "pipe:curl ..."),
    "a shell": Form(
        f"pipe:sh -c 'curl -u {USER}:{PLAIN} http://ADDRESS/raw | ffmpeg -i - {_RAW}'", "pipe:sh ..."
    ),
    "a shell's variable": Form(f"pipe:sh -c 'PASSWORD={PLAIN} cam'", "pipe:sh ..."),
    "an environment": Form(f"pipe:env PASSWORD={MIXED} cam", "pipe:env ..."),
    "an environment without env": Form(f"pipe:PASSWORD={PLAIN} cam", "pipe:..."),
    "an option": Form(f"pipe:cam --password {PLAIN} ADDRESS", "pipe:cam ..."),
    "an option, joined": Form(f"pipe:cam -p{MIXED} ADDRESS", "pipe:cam ..."),
    "an argument": Form(f"pipe:cam ADDRESS {DIGITS}", "pipe:cam ..."),
    "wrong quotes": Form(f"pipe:cam --password '{PLAIN}", "pipe:cam ...", valid=False),
    "no program": Form(f"pipe:rtsp://{USER}:{PLAIN}@ADDRESS/{MIXED}", "pipe:..."),
}
FORMS = {**URLS, **PIPES}
