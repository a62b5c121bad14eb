#!/bin/sh
# Installs what tests need of the system, where that is missing and apt may: programs that send real streams to cameras, and a
# browser for the pages. Never fails: those tests skip then.
export DEBIAN_FRONTEND=noninteractive

have_streams() {
    command -v ffmpeg && gst-inspect-1.0 textoverlay && /usr/bin/python3 -c \
        "import gi; gi.require_version('GstRtspServer', '1.0'); from gi.repository import GstRtspServer"
}

install() {
    [ "$(id -u)" = 0 ] || return 0
    {
        timeout 300 apt-get -qq update && timeout 600 apt-get -qq install --no-install-recommends "$@"
    } </dev/null >/dev/null 2>&1
}

if ! have_streams >/dev/null 2>&1; then
    install ffmpeg gstreamer1.0-tools gstreamer1.0-plugins-base gstreamer1.0-plugins-good gstreamer1.0-plugins-ugly \
        gstreamer1.0-x gir1.2-gst-rtsp-server-1.0 python3-gi
    have_streams >/dev/null 2>&1 || echo "ci: no FFmpeg, GStreamer and its RTSP server: the camera tests that need them skip"
fi
if ! command -v chromium >/dev/null 2>&1; then
    install chromium
    command -v chromium >/dev/null 2>&1 || echo "ci: no Chromium: the tests of pages in a browser skip"
fi
exit 0
