"""Judges a drive again, and compares each frame with how it was judged before."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from anytraverse.assessment import Assessment, Reason
from anytraverse.engine import AnyTraverse
from anytraverse.errors import AnyTraverseError
from anytraverse.judging import Settings
from anytraverse.preferences import Preferences
from anytraverse.regular_file import read_regular
from companion.desk.drives.drive import Drive, DriveError
from companion.desk.drives.judge import FIGURES, DriveJudge, JudgementRow, row
from companion.desk.drives.recorded import RecordedDrive, RecordedFrame, settings_of
from companion.wire.answers import Answer
from companion.wire.ids import Motion

OF_THE_FRAME = frozenset({Reason.UNKNOWN_OBJECT, Reason.BLOCKED})
"""Reasons that follow from one frame, its words and its settings alone."""
OF_A_RECORDING: Mapping[str, float] = {**dict.fromkeys(FIGURES, 0.05), "worst_tile": 0.4}
"""Tolerances of figures where a recording has JPEGs of what the rover judged. A tile is some pixels wide."""
OF_REFERENCES: Mapping[str, float] = dict.fromkeys(FIGURES, 0.005)
"""The same where the frames are the same, pixel by pixel, and the computer or a library may be another."""
_SHOWN = 10
_LARGEST = 1e300
_LARGEST_FILE = 64 << 20
"""Bytes of a file of references, at most."""


@dataclass
class ReplayComparison:
    """What differs between two judgements of the same frames.

    tolerance: by figure. apart: by figure, the differences of all frames. far: frames that differ by more,
    the figure, what it was and what it is. reasons: frames with other reasons. calls: frames that opened a
    call in one of them only. gone: frames that were judged before, and are not any more.
    left_out: why -> frames that could not be compared.
    """

    tolerance: Mapping[str, float]
    frames: int = 0
    apart: dict[str, list[float]] = field(default_factory=lambda: {name: [] for name in FIGURES})
    far: list[tuple[str, str, float | None, float | None]] = field(default_factory=list)
    reasons: list[str] = field(default_factory=list)
    calls: list[str] = field(default_factory=list)
    gone: list[str] = field(default_factory=list)
    left_out: dict[str, list[str]] = field(default_factory=dict)

    @property
    def same(self) -> bool:
        """Whether something was compared, and nothing differs."""
        return self.frames > 0 and not (self.far or self.reasons or self.calls or self.gone)

    def add(self, found: JudgementRow, expected: JudgementRow) -> None:
        """Compare a frame."""
        self.frames += 1
        for name in FIGURES:
            was, now = expected.figures.get(name), found.figures.get(name)
            if was is None or now is None:
                if was is not now:
                    self.far.append((found.name, name, was, now))
                continue
            self.apart[name].append(abs(now - was))
            if not abs(now - was) <= self.tolerance[name]:
                self.far.append((found.name, name, was, now))
        if found.reasons != expected.reasons:
            self.reasons.append(found.name)
        if bool(found.opened) != bool(expected.opened):
            self.calls.append(found.name)

    def leave_out(self, name: str, why: str) -> None:
        """Note a frame that cannot be compared."""
        self.left_out.setdefault(why, []).append(name)

    def lines(self) -> Iterator[str]:
        """Say for a person what was found."""
        for name, apart in self.apart.items():
            if apart:
                middle, most = sorted(apart)[len(apart) // 2], max(apart)
                yield f"{name:<15} differs by {middle:.4f} in the median, {most:.4f} at most"
        for frame, name, was, now in self.far[:_SHOWN]:
            yield f"{frame}: {name} was {_text(was)}, is {_text(now)}"
        if len(self.far) > _SHOWN:
            yield f"... and {len(self.far) - _SHOWN} more"
        for what, names in (
            ("other reasons", self.reasons),
            ("a call in one of them only", self.calls),
            ("not judged any more", self.gone),
        ):
            if names:
                yield f"{what}: {len(names)} frames: {', '.join(names[:_SHOWN])}"
        for why, names in self.left_out.items():
            yield f"not compared, {why}: {len(names)} frames: {', '.join(names[:3])}"

    def figures(self) -> dict[str, Any]:
        """Return the figures as JSON values."""
        return {
            "frames": self.frames,
            "same": self.same,
            "tolerance": dict(self.tolerance),
            "worst": {name: round(max(apart), 6) for name, apart in self.apart.items() if apart},
            "far": len({frame for frame, *_ in self.far}),
            "reasons": len(self.reasons),
            "calls": len(self.calls),
            "gone": len(self.gone),
            "left_out": {why: len(names) for why, names in self.left_out.items()},
        }


def recorded_row(recorded: RecordedFrame) -> JudgementRow:
    """Make the row of how the rover judged a frame."""
    seen, roi = recorded.seen, recorded.seen.get("roi")
    tile = roi.get("worst_tile") if isinstance(roi, dict) else None
    figures = {name: _number(seen.get(name)) for name in FIGURES}
    figures["worst_tile"] = _number(tile.get("uncertainty")) if isinstance(tile, dict) else None
    counts = {one.value for one in OF_THE_FRAME}
    told = seen.get("reasons")
    reasons = [str(one) for one in told if one in counts] if isinstance(told, list) else []
    return JudgementRow(recorded.frame.name, figures, tuple(sorted(reasons)))


def judged_again(engine: AnyTraverse, recorded: RecordedFrame, base: Settings) -> Assessment | str:
    """Judge a recorded frame with the words and settings of then; why it cannot be, for one that cannot.

    The memory of then is not recorded, so that whether the scene was known is not judged.
    base: settings for what was not recorded. Raises AnyTraverseError where the frame cannot be judged, and
    DriveError for recorded settings that cannot be.
    """
    frame = recorded.frame
    if frame.image is None:
        return "a torn picture"
    if not recorded.seen:
        return "without a judgement in the recording"
    if recorded.tapped:
        return "judged with tapped words, which are not recorded"
    if not recorded.words:
        return "without words in the recording"
    try:
        words = Preferences.of(recorded.words)
    except (AnyTraverseError, TypeError, ValueError) as error:
        return f"the recorded words cannot be used: {error}"
    engine.memory = engine.memory.using(words, {})
    engine.settings = settings_of(recorded.judging, base)
    return engine.judge(engine.observe(frame.numbered(1)), frame.at)


def replay_recording(
    engine: AnyTraverse, recording: RecordedDrive, expected: Sequence[JudgementRow] | None
) -> tuple[list[JudgementRow], ReplayComparison]:
    """Judge all frames of a recording again, and compare them.

    expected: references; None: with how the rover judged them.
    """
    rows, found = list[JudgementRow](), ReplayComparison(OF_A_RECORDING)
    base = engine.settings
    for recorded in recording.recorded():
        name = recorded.frame.name
        try:
            again = judged_again(engine, recorded, base)
        except AnyTraverseError as error:
            found.gone.append(name)
            again = str(error)
        if isinstance(again, str):
            found.leave_out(name, again)
            continue
        rows.append(row(name, again, OF_THE_FRAME))
        if expected is None:
            found.add(rows[-1], recorded_row(recorded))
    return rows, found if expected is None else compared(rows, expected, found.left_out)


def replay_drive(judge: DriveJudge, drive: Drive) -> Iterator[JudgementRow]:
    """Judge all frames of a drive by the rules of calls, too. Each call gets a go at once."""
    for frame in drive.frames():
        judged = judge.judge(frame)
        if judged is None:
            continue
        opened = judged.opened.id if judged.opened is not None else 0
        yield row(frame.name, judged.seen, Reason, opened)
        if judge.needs_answer(opened):
            judge.answer(Answer(0, Motion.GO), frame.at)


def compared(
    found: Iterable[JudgementRow],
    expected: Iterable[JudgementRow],
    left_out: Mapping[str, list[str]] | None = None,
) -> ReplayComparison:
    """Compare two judgements of a drive by the names of its frames. left_out: why -> frames not judged."""
    before = {one.name: one for one in expected}
    result = ReplayComparison(OF_REFERENCES, left_out=dict(left_out or {}))
    for one in found:
        if (was := before.pop(one.name, None)) is None:
            result.leave_out(one.name, "not among the references")
        else:
            result.add(one, was)
    result.gone = list(before)
    return result


def write_rows(path: Path, rows: Iterable[JudgementRow]) -> int:
    """Write references, one JSON object a line. Returns how many. Raises OSError."""
    lines = [
        json.dumps(
            {
                "frame": one.name,
                **{name: None if value is None else round(value, 5) for name, value in one.figures.items()},
                "reasons": one.reasons,
                "opened": one.opened,
            }
        )
        for one in rows
    ]
    path.write_text("\n".join([*lines, ""]), encoding="utf-8")
    return len(lines)


def read_rows(path: Path) -> list[JudgementRow]:
    """Read references. Raises DriveError for a file that holds others, and OSError."""
    number, content = 0, read_regular(path, _LARGEST_FILE + 1)
    if len(content) > _LARGEST_FILE:
        raise DriveError(f"{path} is larger than {_LARGEST_FILE >> 20} MiB: these are no references")
    try:
        found = []
        for line in content.decode().splitlines():
            number += 1
            told = json.loads(line)
            figures = {name: _number(told[name]) for name in FIGURES}
            found.append(
                JudgementRow(str(told["frame"]), figures, tuple(told["reasons"]), int(told["opened"]))
            )
    except (ValueError, KeyError, TypeError, OverflowError, RecursionError) as error:
        raise DriveError(f"{path}, line {number} is no reference: --update-refs writes all anew") from error
    return found


def _number(raw: Any) -> float | None:
    if not isinstance(raw, int | float) or isinstance(raw, bool):
        return None
    return float(raw) if abs(raw) <= _LARGEST else None  # what is not finite is not known


def _text(value: float | None) -> str:
    return "not known" if value is None else f"{value:.4f}"
