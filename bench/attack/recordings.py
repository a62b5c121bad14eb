"""Opens recordings at the desk that somebody hostile sent."""

from __future__ import annotations

import os
import subprocess
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path

import cv2
import numpy as np
from mcap.writer import CompressionType, Writer

from bench.attack.outcome import AttackOutcome, peak_memory
from companion.observers.recording.contents import as_json, image
from companion.observers.recording.topics import TOPICS, Topic

CANARY = "a-canary-that-nobody-may-sing"
ESCAPE = "\x1b]0;gotcha\a\x1b[2J"
ENDS_WITHIN, MOST_MB = 40.0, 500
"""s and MB of one command."""
_NAMES_2_8_GB = 31_000, 30_000
"""Columns and rows."""
_CHUNKS, _OF_A_CHUNK = 60, 8 << 20
_SETUP = """\
[perceiver]
name = "{judge}"
[vehicle]
file = "{canary}"
[journal]
folder = "{canary}"
[link]
signing_key = "{canary}"
"""
_OWN = """\
[camera]
source = "folder:."
[perceiver]
name = "builtin:lexicon"
[vehicle]
file = ""
[words]
grass = 1.0
"""
_EVIL_WORDS = '[words]\n"\\u001b]0;gotcha\\u0007\\u001b[2J" = 1.0\n'
_JPEG = bytes(cv2.imencode(".jpg", np.full((120, 160, 3), 90, np.uint8))[1])


def recordings(folder: Path, *, quick: bool) -> AttackOutcome:
    """Replay, rehearse and repair each one: all must end, in little memory, and tell nothing."""
    outcome, longest, most, runs = AttackOutcome(), 0.0, 0, 0
    canary = folder / "canary.toml"
    canary.write_text(f'words = {{ "{CANARY}" = 1.0 }}\n', encoding="utf-8")
    (folder / "companion.toml").write_text(_OWN, encoding="utf-8")
    for name, make in WAYS.items():
        place = folder / name.replace(" ", "-")
        place.mkdir()
        make(place / "000001.mcap", canary)
        for words in _commands(place)[: 2 if quick else None]:
            took, megabytes, code, said = _run(words, place)
            longest, most, runs = max(longest, took), max(most, megabytes), runs + 1
            about = f"{words[0]} of {name}"
            if code not in (0, 1, 2) or "Traceback" in said:
                outcome.reached.append(f"{about}: ended with {code} after {took:.0f} s")
            if megabytes > MOST_MB:
                outcome.reached.append(f"{about}: {megabytes} MB of memory")
            if CANARY in said:
                outcome.secrets.append(about)
            if ESCAPE in said:
                outcome.reached.append(f"{about}: an escape sequence on the terminal")
    outcome.figures = {"commands": runs, "longest_s": round(longest, 1), "most_mb": most}
    return outcome


def _commands(place: Path) -> list[list[str]]:
    file, config = str(place / "000001.mcap"), str(place.parent / "companion.toml")
    return [
        ["replay", file],
        ["rehearse", file, "--no-ask", "--config", config, "--out", str(place / "out")],
        ["replay", str(place), "--config", config],
        ["record", "repair", file],
    ]


def _run(words: list[str], place: Path) -> tuple[float, int, int, str]:
    """Return s, most MB, exit code, and all that was said and written."""
    began, most, said = time.monotonic(), 0, place / "said.txt"
    command = [sys.executable, "-m", "companion", *words]
    with (
        said.open("wb") as out,
        subprocess.Popen(command, stdin=subprocess.DEVNULL, stdout=out, stderr=out) as child,
    ):
        while child.poll() is None:
            most = max(most, peak_memory(child.pid))
            time.sleep(0.02)
            if time.monotonic() - began > ENDS_WITHIN:
                child.kill()
    written = [said, *(path for path in (place / "out").rglob("*") if path.is_file())]
    told = "".join(path.read_text(encoding="utf-8", errors="replace") for path in written)
    return time.monotonic() - began, most, child.returncode, told


def _write(
    path: Path, fill: Callable[[Writer, Mapping[Topic, int]], None], config: str = _OWN, *, whole: bool = True
) -> None:
    with path.open("wb") as file:
        writer = Writer(file, compression=CompressionType.ZSTD)
        writer.start()
        rows = {topic: TOPICS[topic] for topic in Topic}
        channels = {topic: writer.register_channel(row.name, row.encoding, 0) for topic, row in rows.items()}
        setup = as_json({"model": f"lexicon {ESCAPE}", "config": config})
        writer.add_message(channels[Topic.SETUP], 1, setup, 1)
        words = as_json({"words": {"grass": 1.0, ESCAPE: -1.0}})
        writer.add_message(channels[Topic.WORDS], 1, words, 1)
        for number in range(1, 4):
            writer.add_message(channels[Topic.CAMERA], number, image(_JPEG, "jpeg", number), number, number)
            judged = as_json({"frame": number, "traversability": 0.5})
            writer.add_message(channels[Topic.ASSESSMENT], number, judged, number, number)
        fill(writer, channels)
        if whole:
            writer.finish()


def _pipe(path: Path, _: Path) -> None:
    os.mkfifo(path)


def _huge_frame(path: Path, _: Path) -> None:
    png = bytearray(cv2.imencode(".png", np.zeros((8, 8, 3), np.uint8))[1])
    at = png.index(b"IHDR") + 4
    png[at : at + 8] = b"".join(side.to_bytes(4, "big") for side in _NAMES_2_8_GB)
    _write(
        path, lambda writer, at: writer.add_message(at[Topic.CAMERA], 9, image(bytes(png), "png", 9), 9, 9)
    )


def _bomb(path: Path, _: Path) -> None:
    def fill(writer: Writer, channels: Mapping[Topic, int]) -> None:
        for topic, head in ((Topic.CAMERA, image(_JPEG, "jpeg", 9)), (Topic.ASSESSMENT, b'{"a":"')):
            for number in range(_CHUNKS):
                writer.add_message(channels[topic], number, head + b"0" * _OF_A_CHUNK, number, number)
                writer.flush()

    _write(path, fill, whole=False)  # so that it can be repaired


def _files(path: Path, canary: Path) -> None:
    _write(path, lambda *_: None, _SETUP.format(judge="builtin:lexicon", canary=canary))


def _words(path: Path, _: Path) -> None:
    _write(path, lambda *_: None, _EVIL_WORDS)


def _judge(path: Path, canary: Path) -> None:
    _write(path, lambda *_: None, _SETUP.format(judge=f"builtin:{canary}", canary=canary))


def _long_record(path: Path, _: Path) -> None:
    path.write_bytes(b"\x89MCAP0\r\n" + b"\x06" + (2_800_000_000).to_bytes(8, "little") + bytes(4096))


WAYS: Mapping[str, Callable[[Path, Path], None]] = {
    "a pipe": _pipe,
    "a frame that names 2.8 GB": _huge_frame,
    "a record that names 2.8 GB": _long_record,
    "a megabyte that unpacks to a gigabyte": _bomb,
    "settings that name files": _files,
    "a perceiver that is a file": _judge,
    "words that control a terminal": _words,
}
