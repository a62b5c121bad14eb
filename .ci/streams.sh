#!/bin/sh
# Installs what the camera tests with real streams need, where that is missing and apt may. Never fails: those tests skip then.
export DEBIAN_FRONTEND=noninteractive

have() {
    command -v ffmpeg && gst-inspect-1.0 textoverlay && /usr/bin/python3 -c \
        "import gi; gi.require_version('GstRtspServer', '1.0'); from gi.repository import GstRtspServer"
}

if ! have >/dev/null 2>&1; then
    if [ "$(id -u)" = 0 ]; then
        {
            timeout 300 apt-get -qq update &&
                timeout 600 apt-get -qq install --no-install-recommends ffmpeg gstreamer1.0-tools \
                    gstreamer1.0-plugins-base gstreamer1.0-plugins-good gstreamer1.0-plugins-ugly gstreamer1.0-x gir1.2-gst-rtsp-server-1.0 python3-gi
        } </dev/null >/dev/null 2>&1
    fi
    have >/dev/null 2>&1 || echo "ci: no FFmpeg, GStreamer and its RTSP server: the camera tests that need them skip"
fi
exit 0
