"""What is opened at the desk may come from anybody: it must not hang, open others, or fill the memory."""

from __future__ import annotations

import json
import os
import signal
import tracemalloc
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

pytest.importorskip("mcap")

from mcap.writer import CompressionType, Writer

from anytraverse.bundle.class_names import read_class_names
from anytraverse.bundle.manifest import MANIFEST, read_manifest
from anytraverse.errors import AnyTraverseError
from anytraverse.evaluation.labels import FILE as CLASSES
from anytraverse.evaluation.labels import read_classes
from anytraverse.look import read_picture
from anytraverse.perception import make_perceiver
from companion.cli import main
from companion.config import ConfigError, load_config
from companion.desk.drives import recorded
from companion.desk.drives.desk import AnswerFile
from companion.desk.drives.drive import DriveError
from companion.desk.drives.frames import open_drive
from companion.desk.drives.recorded import RecordedDrive
from companion.desk.drives.replay import read_rows
from companion.desk.drives.replaying import config_of
from companion.observers.recording.contents import as_json, image
from companion.observers.recording.reading import messages, repair, summary, whole
from companion.observers.recording.topics import TOPICS, Topic
from tests.companion.desk.drives.record_drive import DRIVE

_HANGS_AFTER = 10.0
PICTURE = cv2.imencode(".jpg", np.full((120, 160, 3), 90, np.uint8))[1].tobytes()


@pytest.fixture
def not_for_ever() -> Iterator[None]:
    """Fail where a call waits for a writer that never comes."""

    def hangs(*_: object) -> None:
        raise AssertionError("it hangs")

    before = signal.signal(signal.SIGALRM, hangs)
    signal.setitimer(signal.ITIMER_REAL, _HANGS_AFTER)
    yield
    signal.setitimer(signal.ITIMER_REAL, 0.0)
    signal.signal(signal.SIGALRM, before)


OPENED: dict[str, tuple[str, Callable[[Path], Any]]] = {
    "a recording": ("000001.mcap", RecordedDrive),
    "a recording in a folder": ("000001.mcap", lambda path: RecordedDrive(path.parent)),
    "a recording to summarize": ("000001.mcap", summary),
    "a recording to repair": ("000001.mcap", repair),
    "whether a recording is whole": ("000001.mcap", whole),
    "messages": ("000001.mcap", lambda path: list(messages(path))),
    "answers": ("answers.txt", AnswerFile),
    "references": ("drive.refs.jsonl", read_rows),
    "a picture": ("1.png", lambda path: read_picture(str(path))),
    "a configuration": ("companion.toml", load_config),
    "a bundle": (MANIFEST, lambda path: read_manifest(path.parent)),
    "words of a bundle": ("words.txt", read_class_names),
    "labels": (CLASSES, lambda path: read_classes(path.parent)),
    "a network": ("own.onnx", lambda path: make_perceiver(f"builtin:{path}")),
}


@pytest.mark.usefixtures("not_for_ever")
@pytest.mark.parametrize("what", OPENED)
def test_a_pipe_where_a_file_should_be_is_refused_at_once(tmp_path: Path, what: str) -> None:
    name, opened = OPENED[what]
    os.mkfifo(tmp_path / name)
    with pytest.raises((OSError, ConfigError, AnyTraverseError)):
        opened(tmp_path / name)


@pytest.mark.usefixtures("not_for_ever")
def test_a_pipe_among_the_pictures_of_a_drive_is_a_torn_frame(tmp_path: Path) -> None:
    os.mkfifo(tmp_path / "1.png")
    (tmp_path / "2.jpg").write_bytes(PICTURE)
    assert [one.image is None for one in open_drive(str(tmp_path), 10.0).frames()] == [True, False]


@pytest.mark.usefixtures("not_for_ever")
def test_replay_says_which_file_is_none(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    os.mkfifo(tmp_path / "000001.mcap")
    for where in (tmp_path / "000001.mcap", tmp_path):
        assert main(["replay", str(where)]) == 2
        assert "no regular file" in (said := capsys.readouterr().err)
        assert "000001.mcap" in said


@pytest.mark.parametrize(
    "hostile",
    [
        '[vehicle]\nfile = "{secret}"\n',
        '[call]\nvotes = 3\n[vehicle]\nfile = "{secret}"\n[roi]\nleft = 0.4\n',
        '[web]\nlisten = "0.0.0.0:80"\ntoken = "{secret}"\n[journal]\nfolder = "{secret}"\n',
        '[link]\nsigning_key = "{secret}"\n[camera]\nsource = "video:{secret}"\n',
        '"vehicle" = {{ "file" = "{secret}" }}\n',
        'vehicle.file = "{secret}"\n',
        'aliases = {{}}\n[vehicle]\nfile = """\n{secret}"""\n',
    ],
)
def test_no_path_in_a_recorded_configuration_is_followed(tmp_path: Path, hostile: str) -> None:
    secret = tmp_path / "secret.toml"
    secret.write_text('words = { "a secret" = 1.0 }\n')
    recording = RecordedDrive(DRIVE)
    recording.config = hostile.format(secret=secret)
    config = str(config_of(recording))
    assert "a secret" not in config
    assert str(secret) not in config


@pytest.mark.parametrize("name", ["clipseg:/opt/bundle", "builtin:/tmp/net.onnx", "dense", "classes:../b"])
def test_a_perceiver_that_lies_on_the_rover_is_named_and_not_looked_for(name: str) -> None:
    recording = RecordedDrive(DRIVE)
    recording.config = f'[perceiver]\nname = "{name}"\n'
    with pytest.raises(DriveError, match=f"judged by {name} of its rover: name one with it by --config"):
        config_of(recording)


def test_what_frames_were_judged_by_is_taken_from_the_recorded_configuration() -> None:
    recording = RecordedDrive(DRIVE)
    config = config_of(recording)
    assert (config.camera.view, config.roi.left, config.mount.height) == (75.0, 0.35, 1.0)
    assert dict(config.words) == {"grass": 1.0, "dirt path": 1.0, "bush": -1.0, "tree": -1.0, "sky": -1.0}
    recording.config = '[perceiver]\nprecision = "int8"\nthreads = 9\n[call]\nvotes = 3\n[later]\nkey = 1\n'
    config = config_of(recording)
    assert (config.perceiver.precision, config.perceiver.threads, config.call.votes) == ("int8", 0, 3)
    recording.config = "x" * (2 << 20)
    with pytest.raises(DriveError, match="larger than 1 MiB"):
        config_of(recording)


def test_what_a_recording_says_does_not_control_the_terminal(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    own = tmp_path / "companion.toml"
    own.write_text(
        '[camera]\nsource = "folder:."\n[vehicle]\nfile = ""\n[perceiver]\nname = "builtin:lexicon"\n'
    )
    path = tmp_path / "000001.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        camera, setup = (
            writer.register_channel(TOPICS[one].name, "", 0) for one in (Topic.CAMERA, Topic.SETUP)
        )
        hostile = {"model": "\x1b[2J", "config": '[words]\n"\\u001b]0;gotcha\\u0007" = 1.0\n'}
        writer.add_message(setup, 1, as_json(hostile), 1)
        writer.add_message(camera, 1, image(PICTURE, "jpeg", 1), 1, 1)
        writer.finish()
    for more in ([], ["--config", str(own)]):
        main(["replay", str(path), *more])
        said = "".join(capsys.readouterr())
        assert said
        assert not [one for one in said if not one.isprintable() and one != "\n"]


def bomb(path: Path, topic: Topic, messages_of_it: int, size: int) -> Path:
    """Write a recording of few bytes that says far more: chunks of zeros."""
    filler = image(PICTURE + bytes(size), "jpeg", 0) if topic is Topic.CAMERA else b'{"a":"' + b"0" * size
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.ZSTD)
        writer.start()
        channels = {one: writer.register_channel(TOPICS[one].name, "json", 0) for one in Topic}
        writer.add_message(channels[Topic.CAMERA], 1, image(PICTURE, "jpeg", 1), 1)
        for number in range(messages_of_it):
            writer.add_message(channels[topic], number, filler, number, number)
            writer.flush()
        writer.finish()
    return path


def read_of(path: Path) -> str:
    """Return how many frames and answers are read, or why not."""
    try:
        recording = RecordedDrive(path)
        frames = sum(one.image is not None for one in recording.frames())
        return f"{frames} frames, {len(recording.answers())} answers"
    except DriveError as error:
        return str(error)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("topic", "said"),
    [
        (Topic.CAMERA, "61 frames, 0 answers"),
        (Topic.ASSESSMENT, "says more than a rover does in a minute"),
        (Topic.WORDS, "says more than a rover does in a minute"),
        (Topic.REQUESTS, "says more than a rover does in a minute"),
    ],
)
def test_a_small_file_that_says_far_more_takes_little_memory(tmp_path: Path, topic: Topic, said: str) -> None:
    path = bomb(tmp_path / "000001.mcap", topic, 60, 8 << 20)
    assert path.stat().st_size < 1 << 20
    tracemalloc.start()
    try:
        assert said in read_of(path)
        assert tracemalloc.get_traced_memory()[1] < 150 << 20, "480 MB are in it"
    finally:
        tracemalloc.stop()


@pytest.mark.slow
def test_schemas_and_channels_are_not_held_without_bound(tmp_path: Path) -> None:
    path = tmp_path / "000001.mcap"
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.ZSTD)
        writer.start()
        for number in range(40):
            schema = writer.register_schema(f"s{number}", "jsonschema", bytes(4 << 20))
            channel = writer.register_channel("/status", "json", schema)
            writer.add_message(channel, number, b"{}", number)
            writer.flush()
    held = {one.schema.id: one.schema for one in messages(path) if one.schema is not None}
    assert 1 <= len(held) < 5


@pytest.mark.parametrize("kind", [".png", ".jpg"])
def test_a_picture_that_states_a_huge_size_is_a_torn_frame(tmp_path: Path, kind: str) -> None:
    content = bytearray(cv2.imencode(kind, np.zeros((8, 8, 3), np.uint8))[1].tobytes())
    at = content.index(b"IHDR") + 4 if kind == ".png" else content.index(b"\xff\xc0") + 5
    size = (60_000).to_bytes(4 if kind == ".png" else 2, "big")
    content[at : at + 2 * len(size)] = 2 * size
    path = tmp_path / "000001.mcap"
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel(TOPICS[Topic.CAMERA].name, "protobuf", 0)
        writer.add_message(channel, 1, image(bytes(content), kind[1:], 1), 1, 1)
        writer.finish()
    (frame,) = RecordedDrive(path).frames()
    assert frame.image is None


def test_frames_come_in_the_order_of_their_times_and_few_are_held(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path, times = tmp_path / "000001.mcap", [3, 1, 2, 6, 5, 4, 9, 7, 8]
    with path.open("wb") as file:
        writer = Writer(file)
        writer.start()
        channel = writer.register_channel(TOPICS[Topic.CAMERA].name, "protobuf", 0)
        judged = writer.register_channel(TOPICS[Topic.ASSESSMENT].name, "json", 0)
        for at in times:
            writer.add_message(judged, at, as_json({"frame": at}), at, at)
            writer.add_message(channel, at, image(PICTURE, "jpeg", at), at, at)
        writer.finish()
    monkeypatch.setattr(recorded, "_HELD", 3)
    found = list(RecordedDrive(path).recorded())
    assert [one.frame.name for one in found] == [f"frame {at}" for at in sorted(times)]
    assert [json.loads(json.dumps(one.seen)) for one in found] == [{"frame": at} for at in sorted(times)]
