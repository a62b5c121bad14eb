"""Makes ten seconds of a recorded drive into an animated picture: the rover stops, is answered, drives on."""

from __future__ import annotations

import json
from bisect import bisect_right
from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from anytraverse.frame import Image
from anytraverse.regions import Box, Region

SECONDS, RATE = 10.0, 8.0
"""How long it is, and its pictures a second."""
BEFORE, AFTER = 2.0, 2.5
"""Seconds of the drive before the call, and after the rover drives on."""
LARGEST = 1_400_000
WIDTH = 560
_QUALITIES = (80, 65, 50, 35, 20)
_BAR, _FOOT = 52, 56
_ON_INK = (233, 236, 239)
_TYPES_FOR = 1.0
"""Seconds in which an answer appears letter by letter."""
_BAD = frozenset({"unknown_object", "blocked"})
_TITLES = {
    "ok": "DRIVES",
    "calling": "STOPS AND ASKS",
    "blocked": "WAITS",
    "holding": "HOLDS",
    "fault": "STOPS: A FAULT",
}


class AnimationError(Exception):
    """Raised where no animation can be made. The message says why."""


class Moment(NamedTuple):
    """What somebody did, or what happened. at: monotonic s. box: the place in the picture, None: nowhere.

    kind: "call", "answer", "told" or "drives on".
    """

    at: float
    kind: str
    text: str
    box: Sequence[float] | None = None


class _Seen(NamedTuple):
    """A recorded frame. captured: monotonic s. maps: signed and uncertainty, grey PNGs."""

    captured: float
    picture: bytes
    maps: tuple[bytes, bytes] | None
    told: dict[str, Any]


def animate(recordings: Path, moments: Sequence[Moment], region: Region, file: Path) -> int:
    """Write the animation, and return its bytes. recordings: a folder of .mcap. region: of interest.

    Raises AnimationError where nothing was recorded, no call was answered, or this OpenCV cannot write it.
    """
    import cv2

    from companion.daemon.live_picture import LEGEND

    if not hasattr(cv2, "Animation"):
        raise AnimationError("no animation: take OpenCV 4.11 or newer: pip install -U opencv-python-headless")
    began, ended = _chosen(moments)
    recorded, states = _recorded(recordings)
    seen = [one for one in recorded if one.captured <= ended]
    if not seen or seen[-1].captured < began:
        raise AnimationError(f"no animation: nothing was recorded in {recordings}")
    pictures, count = [], round(SECONDS * RATE)
    for number in range(count):
        now = began + (ended - began) * number / count
        shown = seen[max(0, bisect_right(seen, now, key=lambda one: one.captured) - 1)]
        state = states[max(0, bisect_right(states, now, key=lambda one: one[0]) - 1)][1] if states else "ok"
        told = [one for one in moments if began <= one.at <= now]
        pictures.append(_drawn(shown, state, told[-1] if told else Moment(now, "told", LEGEND), now, region))
    animation = cv2.Animation()
    animation.frames = [cv2.cvtColor(one, cv2.COLOR_RGB2BGR) for one in pictures]
    animation.durations = [round(1000 / RATE)] * count
    for quality in _QUALITIES:
        done, encoded = cv2.imencodeanimation(".webp", animation, [cv2.IMWRITE_WEBP_QUALITY, quality])
        if not done:
            raise AnimationError("no animation: this OpenCV cannot write WebP")
        if len(encoded) <= LARGEST:
            break
    file.write_bytes(encoded.tobytes())
    return len(encoded)


def _chosen(moments: Sequence[Moment]) -> tuple[float, float]:
    """Return from when to when: around the first call that was answered by a tap and then driven on from."""
    for number, call in enumerate(moments):
        after = moments[number:]
        taps = call.kind == "call" and any(one.kind == "answer" and "tap" in one.text for one in after[:3])
        on = next((one for one in after if one.kind == "drives on"), None)
        if taps and on is not None:
            return call.at - BEFORE, on.at + AFTER
    raise AnimationError("no animation: no call was answered by a tap and driven on from")


def _recorded(folder: Path) -> tuple[list[_Seen], list[tuple[float, str]]]:
    """Return the judged frames that have a picture, and from when on which state held, in monotonic s."""
    from companion.observers.recording.foxglove import jpeg_of
    from companion.observers.recording.reading import messages
    from companion.observers.recording.topics import TOPICS, Topic

    kinds = (Topic.CAMERA, Topic.TRAVERSABILITY, Topic.UNCERTAINTY, Topic.ASSESSMENT, Topic.STATE)
    named, maps = {TOPICS[topic].name: topic for topic in kinds}, kinds[1:3]
    seen: list[_Seen] = []
    states: list[tuple[int, str]] = []
    since = 0.0  # s since 1970 at second 0 of the monotonic clock
    for path in sorted(folder.glob("*.mcap")):
        found: dict[int, dict[Topic, bytes]] = {}
        for one in messages(path, list(named)):
            topic, message = named[one.channel.topic], one.message
            if topic is Topic.STATE:
                states.append((message.log_time, str(json.loads(message.data)["state"])))
                continue
            found.setdefault(message.sequence, {})[topic] = message.data
            if topic is Topic.ASSESSMENT:
                since = message.log_time / 1e9 - json.loads(message.data)["judged_at"]
        for parts in found.values():
            if Topic.CAMERA in parts and Topic.ASSESSMENT in parts:
                told = json.loads(parts[Topic.ASSESSMENT])
                has_maps = all(one in parts for one in maps)
                drawn = (jpeg_of(parts[maps[0]]), jpeg_of(parts[maps[1]])) if has_maps else None
                seen.append(_Seen(told["captured_at"], jpeg_of(parts[Topic.CAMERA]), drawn, told))
    seen.sort(key=lambda one: one.captured)
    return seen, sorted((at / 1e9 - since, state) for at, state in states)


def _drawn(seen: _Seen, state: str, newest: Moment, now: float, region: Region) -> Image:
    import cv2
    import numpy as np

    from anytraverse.drawing import INK, YELLOW, fitted, readable_on, shortened, write
    from anytraverse.judged_picture import draw_boxes, draw_maps
    from companion.vision.pictures import COLOURS
    from companion.wire.ids import State

    picture = fitted(_decoded(seen.picture, cv2.IMREAD_COLOR)[..., ::-1], WIDTH).copy()
    reasons, marked = set(seen.told["reasons"]), _tile(seen.told)
    if not reasons & _BAD:
        marked = None
    if seen.maps is not None:
        shares = (_decoded(one, cv2.IMREAD_GRAYSCALE) / np.float32(255) for one in seen.maps)
        signed, unsure = (np.asarray(one, np.float32) for one in shares)
        draw_maps(picture, 2 * signed - 1, unsure, marked, around="unknown_object" in reasons)
    draw_boxes(picture, region, marked)

    colour = COLOURS[State[state.upper()]]
    bar = np.full((_BAR, WIDTH, 3), colour, np.uint8)
    write(bar, _TITLES.get(state, state.upper()), (14, 37), 30, readable_on(colour), bold=True)
    foot = np.full((_FOOT, WIDTH, 3), INK, np.uint8)
    answers = newest.kind == "answer"
    share = min(1.0, (now - newest.at) / _TYPES_FOR) if answers else 1.0
    text, size = newest.text[: round(share * len(newest.text))], 22 if answers else 17
    write(foot, shortened(text, WIDTH - 28, size), (14, 36), size, _ON_INK, bold=answers)
    if answers and newest.box is not None:
        left, top, right, bottom = newest.box
        at = round((left + right) / 2 * WIDTH), round((top + bottom) / 2 * picture.shape[0])
        cv2.circle(picture, at, 9, YELLOW, -1, cv2.LINE_AA)
        cv2.circle(picture, at, 16, YELLOW, 2, cv2.LINE_AA)
    return np.vstack([bar, picture, foot])


def _decoded(encoded: bytes, flags: int) -> Image:
    """Decode a recorded picture. Raises AnimationError for a damaged one."""
    import cv2
    import numpy as np

    picture = cv2.imdecode(np.frombuffer(encoded, np.uint8), flags)
    if picture is None:
        raise AnimationError("no animation: a recorded picture is damaged")
    return np.asarray(picture, np.uint8)


def _tile(told: dict[str, Any]) -> Box | None:
    """Return the box of the place that a judged frame points at, None where it tells none."""
    tile = (told.get("roi") or {}).get("worst_tile") or {}
    box = tile.get("around") or tile.get("box")
    return None if not isinstance(box, dict) else Box(**box)
