"""What MAVSDK's camera plug-in makes of the companion, typed to: python mavsdk_camera.py udpout://HOST:PORT"""

from __future__ import annotations

import sys
import time
from typing import Any

from mavsdk import ComponentType, Configuration, Mavsdk
from mavsdk.plugins.camera import Camera
from mavsdk.plugins.camera.camera import CameraError

CAMERA = 100


def main(link: str) -> None:
    """Say what is found, and what becomes of "tap LEFT TOP RIGHT BOTTOM", "point X Y RADIUS" and "stop"."""
    mavsdk = Mavsdk(Configuration.create_with_component_type(ComponentType.GROUND_STATION))
    mavsdk.add_any_connection(link)
    camera = Camera(mavsdk.first_autopilot(30.0))
    _say("found", _first(lambda: [one.model_name for one in camera.camera_list().cameras]))
    _say("video", _first(lambda: camera.get_video_stream_info(CAMERA).settings.uri))
    for line in sys.stdin:
        name, *values = line.split()
        numbers = [float(value) for value in values]
        if name == "tap":
            _say(name, _result(lambda n=numbers: camera.track_rectangle(CAMERA, *n)))
        elif name == "point":
            _say(name, _result(lambda n=numbers: camera.track_point(CAMERA, *n)))
        elif name == "stop":
            _say(name, _result(lambda: camera.track_stop(CAMERA)))


def _say(what: str, found: object) -> None:
    print(f"{what}: {found}", flush=True)


def _first(ask: Any) -> Any:
    """What it tells, once it tells something: the plug-in asks the camera by itself."""
    deadline = time.monotonic() + 20.0
    while time.monotonic() < deadline:
        try:
            if found := ask():
                return found
        except CameraError:
            pass
        time.sleep(0.2)
    return None


def _result(do: Any) -> str:
    try:
        do()
    except CameraError as error:
        return str(error)
    return "done"


if __name__ == "__main__":
    main(sys.argv[1])
