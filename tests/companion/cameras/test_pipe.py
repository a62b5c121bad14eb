"""Pictures from a program's output: the whole way with real programs, and all that may happen to them."""

from __future__ import annotations

import contextlib
import logging
import os
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from random import Random
from tempfile import TemporaryDirectory

import cv2
import numpy as np
import pytest

from bench.cameras.servers import installed, writer
from bench.cameras.stamps import age
from companion.cameras import (
    BadFrame,
    CameraError,
    CameraOptions,
    Capture,
    NoFrameYet,
    SourceError,
    open_camera,
)
from companion.cameras import pipe as pipe_module
from companion.cameras.late_frames import CAME_LATE
from companion.cameras.pipe import Pipe
from companion.cameras.pixel_formats import PIXEL_FORMATS, frame_bytes, to_rgb
from tests.waiting import is_gone, wait_for

_GREY = CameraOptions(width=64, height=16, pixel_format="gray", latency=0.05, freshness=1.0)
_SOON = 10.0


@contextlib.contextmanager
def _opened(command: str, options: CameraOptions = _GREY) -> Iterator[Pipe]:
    camera = Pipe(command, options)
    try:
        yield camera
    finally:
        camera.close()


def _python(script: str) -> str:
    return f"{sys.executable} -I -S -c '{script}'"


def _next(camera: Pipe) -> Capture:
    deadline = time.monotonic() + _SOON
    while time.monotonic() < deadline:
        with contextlib.suppress(NoFrameYet, BadFrame):
            return camera.read(0.2)
    raise AssertionError("no picture came in time")


def _failure(camera: Pipe) -> str:
    deadline = time.monotonic() + _SOON
    with pytest.raises(CameraError) as failed:
        _read_until(camera, deadline)
    return str(failed.value)


def _read_until(camera: Pipe, deadline: float) -> None:
    while time.monotonic() < deadline:
        with contextlib.suppress(NoFrameYet, BadFrame):
            camera.read(0.2)


def _wait_until_gone(pid: int) -> None:
    wait_for(lambda: is_gone(pid), _SOON, lambda: f"process {pid} lives on")


def test_pictures_come_new_and_with_their_capture_time() -> None:
    with _opened(writer(640, 480, 50), replace(_GREY, width=640, height=480)) as camera:
        for _ in range(5):
            capture = _next(camera)
            levels = np.ascontiguousarray(capture.image[..., 0]).tobytes()
            assert capture.image.shape == (480, 640, 3)
            assert capture.timed_by == "arrival"
            assert age(levels, 640, 480, capture.captured_at + _GREY.latency) < 0.5


@pytest.mark.parametrize("name", PIXEL_FORMATS)
def test_each_pixel_format_becomes_rgb(name: str) -> None:
    red = np.full((16, 64, 3), (0, 0, 255), np.uint8)
    if name in ("yuv420p", "nv12"):
        planar = cv2.cvtColor(red, cv2.COLOR_BGR2YUV_I420)
        chroma = planar[16:].reshape(2, -1)
        raw = planar if name == "yuv420p" else np.concatenate([planar[:16].ravel(), chroma.T.ravel()])
    elif name in ("yuyv422", "uyvy422"):
        code = cv2.COLOR_BGR2YUV_YUYV if name == "yuyv422" else cv2.COLOR_BGR2YUV_UYVY
        raw = cv2.cvtColor(red, code)
    else:
        raw = {"rgb24": red[..., ::-1], "bgr24": red, "gray": red[..., 2]}[name]
    flat = np.ascontiguousarray(raw, np.uint8).ravel()
    assert flat.size == frame_bytes(name, 64, 16)
    image = to_rgb(flat, name, 64, 16)
    wanted = (255, 255, 255) if name == "gray" else (255, 0, 0)
    assert image.shape == (16, 64, 3)
    assert np.abs(image.astype(int) - wanted).max() <= 3


@pytest.mark.parametrize("name", ["rgb24", "gray"])
def test_a_picture_is_never_written_to_again(name: str) -> None:
    script = "import os,itertools\nfor n in itertools.count(1): os.write(1, bytes([n%256])*{})"
    size = frame_bytes(name, 64, 16)
    with _opened(_python(script.format(size)), replace(_GREY, pixel_format=name)) as camera:
        first = _next(camera)
        before = first.image.copy()
        for _ in range(10):
            _next(camera)
        assert np.array_equal(first.image, before)


@pytest.mark.parametrize(
    "options",
    [CameraOptions(), replace(_GREY, height=None), replace(_GREY, pixel_format="mjpeg")],
)
def test_a_pipe_needs_size_and_format(options: CameraOptions) -> None:
    with pytest.raises(SourceError, match="width, height and pixel_format"):
        Pipe("true", options)


def test_a_size_that_the_format_cannot_have_is_refused() -> None:
    with pytest.raises(SourceError, match="even width and height"):
        Pipe("true", replace(_GREY, width=63, pixel_format="nv12"))


@pytest.mark.parametrize(("command", "why"), [("'", "quotes"), ("''x'", "quotes")])
def test_a_command_that_cannot_be_read_is_refused(command: str, why: str) -> None:
    with pytest.raises(SourceError, match=why):
        Pipe(command, _GREY)


def test_a_program_that_is_not_there_is_named() -> None:
    with pytest.raises(CameraError, match="no-such-program is not installed"):
        Pipe("no-such-program --fast", _GREY)


def test_a_program_that_ends_says_how_with_its_last_words() -> None:
    with _opened(writer(64, 16, 200, 3)) as camera:
        for _ in range(3):
            _next(camera)
        said = _failure(camera)
    assert "ended with exit code 3: no more pictures" in said
    assert "in a shell" in said


def test_the_same_end_is_told_in_the_same_words() -> None:
    said = set[str]()
    for address in ("0x55d0", "0x77aa"):
        script = f'import sys; sys.exit("[rtsp @ {address}] refused")'
        with _opened(_python(script).replace('"', '"')) as camera:
            said.add(_failure(camera))
    assert len(said) == 1


def test_a_killed_program_is_noticed_at_once() -> None:
    with _opened(writer(64, 16, 100)) as camera:
        _next(camera)
        os.killpg(camera.pid, signal.SIGKILL)
        assert "killed by signal 9" in _failure(camera)


def test_a_program_that_closes_its_output_but_lives_on_is_ended() -> None:
    with _opened(_python("import os,time; os.close(1); time.sleep(60)")) as camera:
        pid = camera.pid
        assert "closed its output" in _failure(camera)
    _wait_until_gone(pid)


def test_a_silent_program_only_times_out() -> None:
    with _opened(_python("import time; time.sleep(60)")) as camera:
        began = time.monotonic()
        with pytest.raises(NoFrameYet):
            camera.read(0.05)
        assert 0.05 <= time.monotonic() - began < _SOON


def test_half_a_picture_is_continued_by_the_next_read() -> None:
    script = (
        "import os,time\nos.write(1, bytes(512)); time.sleep(0.4); os.write(1, bytes(512)); time.sleep(60)"
    )
    with _opened(_python(script)) as camera:
        with pytest.raises(NoFrameYet):
            camera.read(0.1)
        assert _next(camera).image.shape == (16, 64, 3)


def test_what_was_sent_during_a_freeze_is_dropped() -> None:
    options = replace(_GREY, width=640, height=480, freshness=0.3)
    with _opened(writer(640, 480, 30), options) as camera:
        for _ in range(10):
            _next(camera)
        os.killpg(camera.pid, signal.SIGSTOP)
        time.sleep(0.5)
        os.killpg(camera.pid, signal.SIGCONT)
        dropped = 0
        while True:
            try:
                capture = camera.read(0.5)
                break
            except NoFrameYet:
                continue
            except BadFrame as late:
                dropped += str(late) == CAME_LATE
        levels = np.ascontiguousarray(capture.image[..., 0]).tobytes()
        assert dropped >= 3
        assert age(levels, 640, 480, time.monotonic()) < 0.4


def test_a_frozen_program_and_what_it_started_are_gone_after_closing(tmp_path: Path) -> None:
    note = tmp_path / "pid"
    script = f"sleep 60 & echo $! > {note}; kill -STOP $$; wait"
    with _opened(f"sh -c '{script}'") as camera:
        wait_for(lambda: note.exists() and note.read_text().strip(), _SOON)
        leader, grandchild = camera.pid, int(note.read_text())
        began = time.monotonic()
    assert time.monotonic() - began < _SOON
    _wait_until_gone(leader)
    _wait_until_gone(grandchild)


def test_the_program_dies_with_the_process_that_started_it(tmp_path: Path) -> None:
    note = tmp_path / "pid"
    command = _python(f'import os,time; open("{note}.new","w").write(str(os.getpid()))\ntime.sleep(60)')
    script = (
        "import sys, time\nfrom companion.cameras import CameraOptions, open_camera\n"
        "camera = open_camera(sys.argv[1], CameraOptions(width=64, height=16, pixel_format='gray'))\n"
        "time.sleep(60)"
    )
    path = Path(f"{note}.new")
    parent = subprocess.Popen([sys.executable, "-c", script, f"pipe:{command}"])
    try:
        wait_for(lambda: path.exists() and path.read_text(), 3 * _SOON)
    finally:
        parent.kill()
        parent.wait(_SOON)
    _wait_until_gone(int(path.read_text()))


@pytest.mark.parametrize("sent", [(640, 478), (632, 480), (320, 240), (800, 600)])
def test_pictures_of_another_size_are_noticed(sent: tuple[int, int]) -> None:
    with _opened(writer(*sent, 60), replace(_GREY, width=640, height=480)) as camera:
        assert "does not send pictures of 640 x 480 gray" in _failure(camera)


@pytest.mark.parametrize(("sent", "wrong"), [(900, True), (1100, True), (1000, False), (3000, False)])
def test_stalls_of_a_busy_computer_neither_hide_a_wrong_size_nor_make_one(sent: int, wrong: bool) -> None:
    """sent: bytes of a picture, where 1000 are configured."""
    sizes, stalls, found = pipe_module._WrongSize(1000), Random(1), False
    waits = dict.fromkeys(range(sent, 200000, sent), 0.05)
    waits |= {stalls.randrange(1, 200_000): stalls.uniform(0.2, 2.0) for _ in range(20)}
    for complete in range(1000, 200_000, 1000):
        for place in sorted(place for place in waits if complete - 1000 < place <= complete):
            sizes.waited(place - complete + 1000, waits[place])
        found = found or sizes.is_wrong()
    assert found is wrong


def test_pictures_of_the_right_size_are_not_called_wrong_whatever_the_writer_holds_back() -> None:
    held = (
        'import os,time\nrest=b""\nwhile True:\n'
        " data=rest+bytes(1024); os.write(1,data[:-24]); rest=data[-24:]; time.sleep(0.02)"
    )
    whole = "import os,time\nwhile True: os.write(1,bytes(700)); os.write(1,bytes(324)); time.sleep(0.01)"
    for script in (held, whole):
        with _opened(_python(script)) as camera:
            for _ in range(40):
                _next(camera)


def test_pictures_of_the_right_size_that_come_in_pieces_as_by_a_slow_network_are_not_called_wrong() -> None:
    pieces = (
        "import os,random,time\nwhile True:\n"
        " os.write(1,bytes(random.randint(100,300))); time.sleep(random.uniform(0.001,0.006))"
    )
    # a busy machine stalls this writer by tens of ms: its own waits are longer
    even = "import os,time\nwhile True: os.write(1,bytes(768)); time.sleep(0.05)"
    with _opened(_python(pieces)) as camera:
        for _ in range(60):
            _next(camera)
    packets = "import os,time\nwhile True: os.write(1,bytes(512)); time.sleep(0.005)"
    with _opened(_python(packets)) as camera:
        for _ in range(60):
            _next(camera)
    with _opened(_python(even)) as camera:
        assert "does not send pictures" in _failure(camera)


@pytest.fixture
def program_folder() -> Iterator[Path]:
    """A folder without a word in its path: words of its command are left out of what a program says."""
    with TemporaryDirectory(prefix="p-") as folder:
        yield Path(folder)


def test_of_the_programs_errors_plain_words_go_to_the_log_once_and_bounded(
    program_folder: Path, caplog: pytest.LogCaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(pipe_module, "_KNOWN_LINES", type(pipe_module._KNOWN_LINES)(maxlen=200))
    script = program_folder / "program.py"
    script.write_text(
        "import sys\n"
        'print("cannot open", sys.argv[1:], "\\x1b[31m: 401 Unauthorized", file=sys.stderr)\n'
        'for n in range(500): print("line " + chr(97 + n % 26) * (n // 26 + 1), file=sys.stderr)\n'
    )
    with caplog.at_level(logging.INFO):
        for _ in range(2):
            with _opened(f"{sys.executable} {script} rtsp://me:sesame@cam/1 --password sesame") as camera:
                _failure(camera)
    lines = [record.getMessage() for record in caplog.records]
    name = os.path.basename(sys.executable)
    assert lines[:2] == [f"{name}: cannot open ... 401 Unauthorized", f"{name}: line a"]
    assert "sesame" not in caplog.text
    assert len(lines) <= 2 * pipe_module._LINES_LOGGED
    assert len(set(lines)) == len(lines)


_FFMPEG = "ffmpeg -v error -re -f lavfi -i testsrc=size=320x240:rate=20 -f rawvideo -pix_fmt {} -"
_GSTREAMER = (
    "gst-launch-1.0 -q videotestsrc is-live=true ! video/x-raw,format=NV12,width=320,height=240 ! fdsink"
)


@pytest.mark.parametrize(
    ("program", "command", "name"),
    [
        ("ffmpeg", _FFMPEG, "yuv420p"),
        ("ffmpeg", _FFMPEG, "rgb24"),
        ("gst-launch-1.0", _GSTREAMER, "nv12"),
    ],
)
def test_the_lines_for_ffmpeg_and_gstreamer_work(program: str, command: str, name: str) -> None:
    if not installed(program):
        pytest.skip(f"needs {program}: sudo apt install ffmpeg gstreamer1.0-tools")
    options = replace(_GREY, width=320, height=240, pixel_format=name)
    camera = open_camera(f"pipe:{command.format(name)}", options)
    try:
        assert isinstance(camera, Pipe)
        images = [_next(camera).image for _ in range(25)]
    finally:
        camera.close()
    assert images[0].shape == (240, 320, 3)
    # Both test pictures begin with bars of colour: grey would mean that the format was taken for another one.
    assert np.ptp(images[-1].astype(int), axis=2).mean() > 50
