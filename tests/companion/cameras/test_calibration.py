"""A lens's calibration: files as OpenCV and ROS write them are read, all else is refused in words."""

from __future__ import annotations

import json
import math
import re
import time
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from companion.cameras.calibration import CalibrationError, LensCalibration, read_calibration

cv2 = pytest.importorskip("cv2")

MATRIX = np.array([[410.25, 0.0, 326.5], [0.0, 411.5, 236.75], [0.0, 0.0, 1.0]])
DISTORTION = np.array([[-0.31, 0.12, 0.0007, -0.0011, -0.0221]])
ROS = """\
image_width: 640
image_height: 480
camera_name: head_camera   # of the rover
camera_matrix:
  rows: 3
  cols: 3
  data: [410.25, 0.0, 326.5,
         0.     , 411.5, 236.75,
         0.     ,   0.     ,   1.     ]
distortion_model: plumb_bob
distortion_coefficients:
  rows: 1
  cols: 5
  data: [-0.31, 0.12, 7e-4, -1.1e-3, -0.0221]
rectification_matrix:
  rows: 3
  cols: 3
  data: [1, 0, 0, 0, 1, 0, 0, 0, 1]
projection_matrix:
  rows: 3
  cols: 4
  data: [.nan, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0]
"""


def written(path: Path, *, size: tuple[str, str] = ("image_width", "image_height"), **more: Any) -> Path:
    """Write a calibration as OpenCV's sample does, with what it writes beside it."""
    file = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    file.write("calibration_time", "Thu 01 Jan 2026 10:00:00 AM CET")
    file.write(size[0], 640)
    file.write(size[1], 480)
    file.writeComment("flags: +fix_aspectRatio")
    file.write("camera_matrix", MATRIX)
    file.write("distortion_coefficients", DISTORTION)
    for key, value in more.items():
        file.write(key, value)
    file.write("per_view_reprojection_errors", np.ones((20, 1), np.float32))
    file.write("image_points", np.ones((20, 54, 2), np.float32))
    file.release()
    return path


def refusal(folder: Path, content: str | bytes) -> str:
    path = folder / "lens.yaml"
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    with pytest.raises(CalibrationError) as caught:
        read_calibration(path)
    text = str(caught.value)
    assert text.startswith(f"{path} ")
    return text.removeprefix(f"{path} ")


@pytest.mark.parametrize("ending", ["yml", "yaml", "xml", "json"])
@pytest.mark.parametrize("size", [("image_width", "image_height"), ("image_Width", "image_Height")])
def test_what_opencv_writes_is_read_exactly(tmp_path: Path, ending: str, size: tuple[str, str]) -> None:
    found = read_calibration(written(tmp_path / f"lens.{ending}", size=size))
    assert (found.width, found.height) == (640, 480)
    assert found.lens == (410.25, 411.5, 326.5, 236.75)
    assert found.distortion == tuple(DISTORTION.ravel())


def test_what_ros_writes_is_read_as_what_opencv_writes(tmp_path: Path) -> None:
    path = tmp_path / "ros.yaml"
    path.write_text(ROS)
    assert read_calibration(path) == read_calibration(written(tmp_path / "lens.yml"))


@pytest.mark.parametrize("before", ["%YAML:1.0\n---\n", "\ufeff"])
def test_a_header_and_windows_ends_of_lines_change_nothing(tmp_path: Path, before: str) -> None:
    path = tmp_path / "ros.yaml"
    path.write_bytes((before + ROS).replace("\n", "\r\n").encode())
    assert read_calibration(path).lens == (410.25, 411.5, 326.5, 236.75)


def test_numbers_one_a_line_are_read_too(tmp_path: Path) -> None:
    path = tmp_path / "ros.yaml"
    path.write_text(
        re.sub(r"\[-0.31, (.*)\]", "\n  - -0.31\n  - 0.12\n  - 7e-4\n  - -1.1e-3\n  - -0.0221", ROS)
    )
    assert read_calibration(path).distortion == (-0.31, 0.12, 7e-4, -1.1e-3, -0.0221)


@pytest.mark.parametrize("count", [4, 5, 8, 12, 14])
def test_each_of_opencvs_models_is_read(tmp_path: Path, count: int) -> None:
    coefficients = [-0.31, 0.12, 0.0007, -0.0011, -0.0221, 0.01, 0.02, 0.001, *[0.0005] * 4, 0.01, 0.02]
    text = ROS.replace("plumb_bob", "rational_polynomial").replace("cols: 5", f"cols: {count}")
    text = re.sub(r"\[-0.31.*\]", str(coefficients[:count]), text)
    path = tmp_path / "lens.yaml"
    path.write_text(text)
    assert len(read_calibration(path).distortion) == count


def test_the_view_is_the_one_that_opencv_finds_without_borders(tmp_path: Path) -> None:
    found = read_calibration(written(tmp_path / "lens.yml"))
    new, _ = cv2.getOptimalNewCameraMatrix(MATRIX, DISTORTION, (640, 480), 0.0, centerPrincipalPoint=True)
    theirs = 2.0 * math.degrees(math.atan(320.0 / max(new[0, 0], new[1, 1])))
    assert found.view == pytest.approx(theirs, abs=0.05)
    assert found.fits(found.view)
    assert not found.fits(found.view + 0.02)


def test_a_lens_without_distortion_keeps_its_view() -> None:
    focal = 320.0 / math.tan(math.radians(35.0))
    lens = LensCalibration(640, 480, (focal, focal, 319.5, 239.5), (0.0,) * 5)
    assert lens.fits(69.99)
    assert not lens.fits(70.01)


def test_the_rectified_lens_is_told_over_the_pictures_width_and_height(tmp_path: Path) -> None:
    found = read_calibration(written(tmp_path / "lens.yml"))
    fx, fy, cx, cy = found.rectified
    assert (cx, cy) == (0.5, 0.5)
    assert math.degrees(2.0 * math.atan(0.5 / fx)) == pytest.approx(found.view)
    assert fx * 640 == pytest.approx(fy * 480)  # square pixels


@pytest.mark.parametrize(
    ("before", "after", "told"),
    [
        ("plumb_bob", "equidistant", "is of a fisheye model, which is not rectified: calibrate without it"),
        ("plumb_bob", '"fisheye"', "is of a fisheye model"),
        ("image_width", "fisheye_model: 1\nimage_width", "is of a fisheye model"),
        ("plumb_bob", "division", "has a distortion_model that is not plumb_bob or rational_polynomial"),
        ("image_width: 640\n", "", "has no image_width: name the file that the calibration wrote"),
        ("camera_matrix:", "matrix:", "has no camera_matrix: "),
        ("distortion_coefficients:", "coefficients:", "has no distortion_coefficients: "),
        ("640", "640.5", "has an image_width that is no whole number from 16 to 8192"),
        ("480", "100000", "has an image_height that is no whole number from 16 to 8192"),
        ("480", "", "has an image_height that is no whole number"),
        ("480", "60", "has an image_width that does not fit its image_height"),
        ("410.25", "-410.25", "has a focal length in camera_matrix that is not above 0"),
        ("411.5", "0.0", "has a focal length in camera_matrix that is not above 0"),
        ("326.5", "640", "has the centre of its camera_matrix outside of the picture"),
        ("236.75", "-1", "has the centre of its camera_matrix outside of the picture"),
        ("410.25", "nan", "has something in camera_matrix that is no finite number"),
        ("410.25", ".Inf", "has something in camera_matrix that is no finite number"),
        ("410.25", "1e999", "has something in camera_matrix that is no finite number"),
        ("410.25", "4_1_0", "has something in camera_matrix that is no finite number"),
        ("410.25", "1" * 400, "has something in camera_matrix that is no finite number"),
        ("0.0, 326.5", "0.5, 326.5", "has a camera_matrix that is not fx 0 cx, 0 fy cy, 0 0 1"),
        ("-0.31, ", "", "has a distortion_coefficients whose rows, cols and data do not fit together"),
        ("cols: 5\n  data: [-0.31, ", "cols: 4\n  data: [", None),
        ("cols: 5\n  data: [-0.31, 0.12, ", "cols: 3\n  data: [", "has 3 distortion_coefficients: calibrate"),
        ("-0.31", "1e300", "leaves less than 10 degrees that can be rectified"),
        ("-0.31", "-900.0", "leaves less than 10 degrees that can be rectified"),
        ("410.25", "9000.0", "leaves less than 10 degrees that can be rectified"),
        ("camera_name", "Image_width", "has a key twice: keep one calibration in it"),
    ],
)
def test_what_is_wrong_in_a_file_is_told(tmp_path: Path, before: str, after: str, told: str | None) -> None:
    text = ROS.replace(before, after, 1)
    assert text != ROS
    if told is None:
        (tmp_path / "lens.yaml").write_text(text)
        read_calibration(tmp_path / "lens.yaml")
    else:
        assert refusal(tmp_path, text).startswith(told)


@pytest.mark.parametrize(
    "content",
    [
        b"\xff\xfe\x00",
        "{",
        '{"a": 1} 2',
        "<a>",
        "<?xml version='1.0'?><!DOCTYPE a [<!ENTITY b 'c'>]><a>&b;</a>",
        "{" * 100_000,
        '{"a":' * 100_000,
        '{"a": ' + "9" * 5000 + "}",
    ],
)
def test_what_no_calibration_ever_wrote_is_refused(tmp_path: Path, content: str | bytes) -> None:
    assert refusal(tmp_path, content).startswith("is no calibration by OpenCV (YAML, XML, JSON) or ROS's")


@pytest.mark.slow
@pytest.mark.parametrize(
    "content",
    [
        "a:" * 524_000,
        "a:\n" + " b\n" * 349_000,
        " \n" * 524_000,
        "{" + "\n" * 1_048_000,
        "<a>" * 349_000,
        "<a>" + "<b></b>" * 149_000 + "</a>",
        "<a>" * 149_000 + "</a>" * 149_000,
        "image_width: " + "1 " * 520_000,
        "image_width: " + "[" * 1_048_000,
        " #" * 524_000,
    ],
)
def test_a_file_made_to_be_slow_is_refused_within_seconds(tmp_path: Path, content: str) -> None:
    began = time.monotonic()
    refusal(tmp_path, content)
    assert time.monotonic() - began < 5.0


def test_a_file_that_is_too_long_is_refused(tmp_path: Path) -> None:
    assert refusal(tmp_path, ROS + "#" * (1 << 20)).startswith("is larger than 1 MiB")


def test_a_file_that_is_not_there_and_a_folder_are_told(tmp_path: Path) -> None:
    with pytest.raises(
        CalibrationError, match=r"there is no file .*lens\.yml: docs/cameras.md says how to make"
    ):
        read_calibration(tmp_path / "lens.yml")
    with pytest.raises(CalibrationError, match="cannot be read: is a directory"):
        read_calibration(tmp_path)


_PIECES = st.sampled_from(
    [
        *("camera_matrix", "distortion_coefficients", "image_width", "image_height", "rows", "cols", "data"),
        *(
            "distortion_model",
            "plumb_bob",
            ":",
            ": ",
            "\n",
            "\n  ",
            "[",
            "]",
            "{",
            "}",
            ",",
            '"',
            "<",
            ">",
            "</",
        ),
        *("1", "3", "640", "480", "-0.3", "nan", "1e999", "%YAML:1.0\n---\n", "- ", "#", "!!opencv-matrix"),
        *("<?xml version='1.0'?>", "<opencv_storage>", "&amp;", "\x00", "\u2028", "é"),
    ]
)


def own_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The same for each example. Other tests name what they write beside it as they like."""
    folder = tmp_path_factory.getbasetemp() / "calibrations"
    folder.mkdir(exist_ok=True)
    return folder


def _read_or_refused(path: Path, content: bytes) -> None:
    path.write_bytes(content)
    told = ""
    try:
        found = read_calibration(path)
        assert 10.0 <= found.view <= 170.0
        assert all(map(math.isfinite, (*found.lens, *found.distortion)))
    except CalibrationError as error:
        told = str(error)
    assert told == "" or (told.startswith(f"{path} ") and ": " in told)


@settings(max_examples=300, deadline=None)
@given(st.binary(max_size=300) | st.lists(_PIECES, max_size=60).map(lambda pieces: "".join(pieces).encode()))
def test_whatever_stands_in_a_file_it_is_read_or_refused_in_words(
    tmp_path_factory: pytest.TempPathFactory, content: bytes
) -> None:
    _read_or_refused(own_folder(tmp_path_factory) / "rubbish.yml", content)


@pytest.mark.slow
@settings(max_examples=300, deadline=None)
@given(
    st.sampled_from(["yml", "xml", "json", "ros"]),
    st.lists(
        st.tuples(st.integers(0, 1400), st.integers(0, 12), st.binary(max_size=4)), min_size=1, max_size=4
    ),
)
def test_a_damaged_file_is_read_or_refused_in_words(
    tmp_path_factory: pytest.TempPathFactory, ending: str, damages: list[tuple[int, int, bytes]]
) -> None:
    folder = own_folder(tmp_path_factory)
    whole = folder / f"whole.{ending}"
    if not whole.exists():
        whole.write_text(ROS) if ending == "ros" else written(whole)
    content = whole.read_bytes()
    for at, length, put in damages:
        content = content[:at] + put + content[at + length :]
    _read_or_refused(folder / "damaged", content)


@pytest.mark.slow
@settings(max_examples=200, deadline=None)
@given(
    st.tuples(*[st.floats(-1.0, 700.0) | st.floats(allow_nan=False, allow_infinity=False)] * 4),
    st.sampled_from([4, 5, 8, 12, 14]).flatmap(
        lambda count: st.lists(
            st.floats(allow_nan=False, allow_infinity=False) | st.floats(-2, 2),
            min_size=count,
            max_size=count,
        )
    ),
)
def test_whatever_numbers_a_calibration_has_it_is_read_or_refused_in_words(
    tmp_path_factory: pytest.TempPathFactory, lens: tuple[float, ...], distortion: list[float]
) -> None:
    fx, fy, cx, cy = lens
    content = {
        "image_width": 640,
        "image_height": 480,
        "camera_matrix": {"rows": 3, "cols": 3, "data": [fx, 0, cx, 0, fy, cy, 0, 0, 1]},
        "distortion_coefficients": {"rows": 1, "cols": len(distortion), "data": distortion},
    }
    _read_or_refused(own_folder(tmp_path_factory) / "numbers.json", json.dumps(content).encode())
