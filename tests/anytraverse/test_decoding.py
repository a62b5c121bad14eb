"""A picture's size is read before it is decoded, and one that is too large is not decoded."""

from __future__ import annotations

import struct
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from anytraverse import decoding
from anytraverse.decoding import MAX_PIXELS, PictureTooLargeError, decode
from anytraverse.evaluation.datasets.dataset import _decoded
from anytraverse.evaluation.labels import DatasetError
from anytraverse.look import PictureError, read_picture
from anytraverse.picture_size import jpeg_size, picture_size
from companion.cameras import BadFrame, CameraError, CameraOptions, open_camera
from companion.vision.pictures import from_png

KINDS = (".png", ".jpg", ".bmp", ".webp", ".tiff")


def a_file(kind: str, width: int, height: int) -> bytes:
    picture = np.random.default_rng(0).integers(0, 255, (height, width, 3), np.uint8)
    done, content = cv2.imencode(kind, picture)
    assert done
    return content.tobytes()


def a_huge_png(side: int = 20_000) -> bytes:
    """A few bytes whose header says that it is large; decoders ask for the memory before they read on."""

    def chunk(kind: bytes, data: bytes) -> bytes:
        return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))

    header = chunk(b"IHDR", struct.pack(">IIBBBBB", side, side, 8, 2, 0, 0, 0))
    pixels = chunk(b"IDAT", zlib.compress(b"\0" * 1000))
    return b"\x89PNG\r\n\x1a\n" + header + pixels + chunk(b"IEND", b"")


@given(st.sampled_from(KINDS), st.integers(1, 300), st.integers(1, 300))
def test_the_header_says_what_the_decoder_finds(kind: str, width: int, height: int) -> None:
    content = a_file(kind, width, height)
    picture = decode(content)
    assert picture is not None
    assert picture_size(content) == (width, height) == (picture.shape[1], picture.shape[0])


def test_a_lossless_webp_and_a_tiff_of_the_other_byte_order_tell_their_size_too() -> None:
    done, lossless = cv2.imencode(".webp", np.zeros((30, 70, 3), np.uint8), [cv2.IMWRITE_WEBP_QUALITY, 101])
    assert done
    assert picture_size(lossless.tobytes()) == (70, 30)
    entries = struct.pack(">HHIHH", 256, 3, 1, 70, 0) + struct.pack(">HHII", 257, 4, 1, 30)
    assert picture_size(b"MM\0*" + struct.pack(">IH", 8, 2) + entries) == (70, 30)


@pytest.mark.parametrize(
    "piece", [b"\xff\xfe\0\2", b"\xff", b"\xff\0", b"\xff\xd0"], ids=["comments", "fill", "zeros", "restarts"]
)
def test_a_size_behind_more_markers_than_a_camera_writes_is_not_looked_for(piece: bytes) -> None:
    content = a_file(".jpg", 70, 30)
    few, many = (content[:2] + times * piece + content[2:] for times in (100, 100_000))
    assert jpeg_size(few) == (70, 30)
    assert jpeg_size(many) is None
    assert decode(many) is None


@given(st.sampled_from(KINDS), st.integers(0, 400), st.binary(max_size=40))
def test_what_is_torn_or_changed_is_a_picture_that_fits_or_none(kind: str, cut: int, junk: bytes) -> None:
    content = a_file(kind, 20, 10)
    for damaged in (content[:cut], content[:cut] + junk + content[cut + len(junk) :], junk):
        size = picture_size(damaged)
        if size is None or size[0] * size[1] <= MAX_PIXELS:
            picture = decode(damaged)
            assert picture is None or picture.shape[0] * picture.shape[1] <= MAX_PIXELS
        else:
            with pytest.raises(PictureTooLargeError):
                decode(damaged)


def test_what_is_none_of_the_kinds_is_not_decoded() -> None:
    done, content = cv2.imencode(".ppm", np.zeros((4, 4, 3), np.uint8))
    assert done
    assert decode(content.tobytes()) is None
    assert decode(b"") is None


def test_a_file_of_too_many_bytes_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(decoding, "MAX_BYTES", 100)
    with pytest.raises(PictureTooLargeError, match="make the picture smaller"):
        decode(bytes(101))


def test_every_reader_of_pictures_names_the_file_that_is_too_large(tmp_path: Path) -> None:
    path = tmp_path / "0001.png"
    path.write_bytes(a_huge_png())
    told = r"0001\.png: 20000 x 20000 pixels, and at most 50 million are decoded: make the picture smaller"
    with pytest.raises(BadFrame, match=told):
        open_camera(f"folder:{tmp_path}").read(1.0)
    with pytest.raises(PictureError, match=told):
        read_picture(str(path))
    with pytest.raises(DatasetError, match=told):
        _decoded(path, cv2.IMREAD_COLOR)
    with pytest.raises(ValueError, match="20000 x 20000 pixels"):
        from_png(path.read_bytes())


def test_a_video_of_frames_too_large_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "a.avi"
    writer = cv2.VideoWriter(str(path), cv2.VideoWriter.fourcc(*"MJPG"), 10.0, (64, 48))
    writer.write(np.zeros((48, 64, 3), np.uint8))
    writer.release()
    monkeypatch.setattr(decoding, "MAX_PIXELS", 3000)
    with pytest.raises(CameraError, match=r"a\.avi: 64 x 48 pixels"):
        open_camera(f"video:{path}", CameraOptions())
