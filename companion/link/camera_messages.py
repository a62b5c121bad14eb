"""Builds what the MAVLink camera says of itself (Camera Protocol v2)."""

from __future__ import annotations

import math
from typing import Any

from pymavlink.dialects.v20 import development as mavlink

from anytraverse.regions import Box
from anytraverse.release import own_version
from companion.config.video import CameraSettings
from companion.link.encode import packed_version

NAME = "AnyTraverse"
STREAM = 1
"""The id of the only video stream."""
_FLAGS = (
    mavlink.CAMERA_CAP_FLAGS_HAS_VIDEO_STREAM
    | mavlink.CAMERA_CAP_FLAGS_HAS_TRACKING_POINT
    | mavlink.CAMERA_CAP_FLAGS_HAS_TRACKING_RECTANGLE
)
_NAN = math.nan


def heartbeat() -> Any:
    """HEARTBEAT of a camera."""
    return mavlink.MAVLink_heartbeat_message(
        mavlink.MAV_TYPE_CAMERA, mavlink.MAV_AUTOPILOT_INVALID, 0, 0, mavlink.MAV_STATE_ACTIVE, 3
    )


def information(size: tuple[int, int]) -> Any:
    """CAMERA_INFORMATION. size: height and width of the video, pixels."""
    name = list(NAME.encode().ljust(32, b"\0"))
    return mavlink.MAVLink_camera_information_message(
        time_boot_ms=0,
        vendor_name=name,
        model_name=name,
        firmware_version=packed_version(own_version()),
        focal_length=_NAN,
        sensor_size_h=_NAN,
        sensor_size_v=_NAN,
        resolution_h=size[1],
        resolution_v=size[0],
        lens_id=0,
        flags=_FLAGS,
        cam_definition_version=0,
        cam_definition_uri=b"",
    )


def stream_information(settings: CameraSettings, size: tuple[int, int], url: str) -> Any:
    """VIDEO_STREAM_INFORMATION. size: as above. url: at most 159 ASCII characters."""
    return mavlink.MAVLink_video_stream_information_message(
        stream_id=STREAM,
        count=1,
        type=mavlink.VIDEO_STREAM_TYPE_RTSP,
        **_stream(settings, size),
        name=NAME.encode(),
        uri=url.encode(),
        encoding=mavlink.VIDEO_STREAM_ENCODING_H264,
    )


def stream_status(settings: CameraSettings, size: tuple[int, int]) -> Any:
    """VIDEO_STREAM_STATUS. size: as above."""
    return mavlink.MAVLink_video_stream_status_message(stream_id=STREAM, **_stream(settings, size))


def _stream(settings: CameraSettings, size: tuple[int, int]) -> dict[str, Any]:
    return {
        "flags": mavlink.VIDEO_STREAM_STATUS_FLAGS_RUNNING,
        "framerate": settings.rate,
        "resolution_h": size[1],
        "resolution_v": size[0],
        "bitrate": 0,
        "rotation": 0,
        "hfov": settings.view,
    }


def tracking_status(box: Box | None) -> Any:
    """CAMERA_TRACKING_IMAGE_STATUS. box: what was tapped, None for nothing."""
    if box is None:
        idle = mavlink.CAMERA_TRACKING_STATUS_FLAGS_IDLE, mavlink.CAMERA_TRACKING_MODE_NONE, 0
        return mavlink.MAVLink_camera_tracking_image_status_message(*idle, *[_NAN] * 7)
    shown = mavlink.CAMERA_TRACKING_TARGET_DATA_RENDERED | mavlink.CAMERA_TRACKING_TARGET_DATA_IN_STATUS
    active = mavlink.CAMERA_TRACKING_STATUS_FLAGS_ACTIVE, mavlink.CAMERA_TRACKING_MODE_RECTANGLE, shown
    sides = box.left, box.top, box.right, box.bottom
    return mavlink.MAVLink_camera_tracking_image_status_message(*active, _NAN, _NAN, _NAN, *sides)


def settings() -> Any:
    """CAMERA_SETTINGS: it takes videos, and has neither zoom nor focus."""
    return mavlink.MAVLink_camera_settings_message(0, mavlink.CAMERA_MODE_VIDEO, _NAN, _NAN)


def no_storage() -> Any:
    """STORAGE_INFORMATION: it stores nothing."""
    return mavlink.MAVLink_storage_information_message(
        0, 0, 0, mavlink.STORAGE_STATUS_NOT_SUPPORTED, 0, 0, 0, 0, 0
    )


def no_capture() -> Any:
    """CAMERA_CAPTURE_STATUS: it captures nothing."""
    return mavlink.MAVLink_camera_capture_status_message(0, 0, 0, 0, 0, 0)
