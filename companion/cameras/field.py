"""Reads the simulated field's camera over loopback TCP: `field:127.0.0.1:PORT`."""

from __future__ import annotations

import ipaddress

from companion.cameras import CameraError, CameraOptions, Capture, NoFrameYet, SourceError
from companion.cameras.frame_socket import FrameError, FrameStream, FrameTimeout
from companion.cameras.shown import shown


class FieldCamera:
    """Delivers frames of the simulated field, with the capture times that the simulator set.

    The capture times are of this computer's monotonic clock, so the address must be a loopback address.
    """

    def __init__(self, place: str, _: CameraOptions) -> None:
        host, port = _address(place)
        try:
            self._stream = FrameStream(host, port)
        except FrameError as error:
            raise CameraError(str(error)) from error

    def read(self, timeout: float) -> Capture:
        try:
            frame = self._stream.read(timeout)
        except FrameTimeout as error:
            raise NoFrameYet(str(error)) from error
        except FrameError as error:
            raise CameraError(str(error)) from error
        return Capture(frame.captured_at, frame.rgb, "sensor")

    def close(self) -> None:
        self._stream.close()


def _address(place: str) -> tuple[str, int]:
    host, _, number = place.rpartition(":")
    try:
        port = int(number)
        loopback = host == "localhost" or ipaddress.ip_address(host.strip("[]")).is_loopback
    except ValueError:
        raise SourceError("the field's camera is at no such address: write field:127.0.0.1:PORT") from None
    if not loopback or not 0 < port < 65536:
        raise SourceError(
            f"{shown(f'field:{place}')} is no loopback address with a port: write field:127.0.0.1:PORT"
        )
    return host.strip("[]"), port
