"""Measures at which marks on the ground a thing would stop the rover: `companion check --zone`.

A person carries the thing, and presses Enter at each mark. Nothing is commanded; no autopilot is asked.
"""

from __future__ import annotations

import signal
import time
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryFile

from anytraverse.errors import AnyTraverseError
from companion.config import Config, ConfigError, load_config, state_folder
from companion.config.stopping import Stopping
from companion.daemon.policy.hold_gate import HoldConditions, HoldGate
from companion.desk.check.here import status
from companion.desk.check.new_thing import NewThing
from companion.desk.check.typed_lines import TypedLines
from companion.desk.check.zone_file import FOLDER, ZoneArc, ZoneLook, ZoneMark, write_zone
from companion.desk.check.zone_judge import NotMeasuredError, ZoneFrames, ZoneJudge
from companion.desk.check.zone_plan import (
    LineVerdict,
    WalkLine,
    typed_distances,
    verdicts,
    walk_distances,
    walk_lines,
)
from companion.desk.check.zone_report import conclusion, light_text, table
from companion.storage.database import JournalError
from companion.storage.journal_copy import read_stored_memory
from companion.system.as_owner import as_owner
from companion.system.computer import existing

LONGEST = 3600.0
"""Seconds without a key after which it ends by itself."""
ARC_LONGEST = 120.0
"""Seconds of a walk along an arc."""
_MOST_WAIT = 60
_RUNS = (
    "the companion runs and holds the camera: sudo systemctl stop companion, then type this again, and "
    "sudo systemctl start companion when you have measured"
)
_OPENING = """\
Detection zone: carry a thing to marks on the ground; it says from which of them the rover would stop for it.
The rover: disarmed, on low blocks, wheels off the ground, before such ground as it drives on.
The marks: by tape, from the middle of its front, along lines through these points:"""
_KEYS = (
    "Enter: measure, stand still for 2 s, till it rings; a number: wait so many seconds first; "
    "b: the mark before; n: the next line; q: end"
)


def measure_zone(file: str, typed: TypedLines | None = None) -> int:
    """Lead through the walk, and print what was noticed. Returns 1 where nothing could be measured.

    What was measured is kept after each mark, and after `q`, Ctrl-C and the end of input.
    """
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    try:
        config = load_config(file)
        folder = state_folder(config)
        if status(folder) is not None:
            print(_RUNS)
            return 1
        judge = ZoneJudge(config, read_stored_memory(folder))
    except (ConfigError, JournalError, AnyTraverseError) as error:
        print(error)
        return 1
    walk = None
    try:
        walk = ZoneWalk(config, folder, judge, typed or TypedLines())
        walk.go()
    except (EOFError, KeyboardInterrupt):
        print()
    except OSError as error:
        why = (error.strerror or str(error)).lower()
        print(f"{folder} cannot be written ({why}): check the disk, or type this with sudo")
    finally:
        judge.close()
    return 1 if walk is None else walk.conclude()


class ZoneWalk:
    """One walk of a person: its plan, and what was measured so far."""

    def __init__(self, config: Config, folder: Path, judge: ZoneJudge, typed: TypedLines) -> None:
        """folder: the data folder. Raises OSError where it cannot be written."""
        self._folder, self._judge, self._typed = folder, judge, typed
        guides, settings = config.call.policy == "guide", judge.engine.settings
        judged = HoldGate(config).stopping(HoldConditions(settings, judge.step, guides=guides))
        self._stopping: Stopping | None = judged if isinstance(judged, Stopping) else None
        self._unknown = judged if isinstance(judged, str) else ""
        needs = self._needs = None if self._stopping is None else self._stopping.needs
        ground = settings.metres
        near, far = (None, None) if ground is None else (ground.near, ground.far)
        self._lines = walk_lines(config, needs)
        self._empty: ZoneFrames | None = None
        planned = walk_distances(self._lines, needs, near, far)
        self._zone = replace(judge.described(self._stopping), distances=planned)
        with as_owner(folder), TemporaryFile(dir=existing(folder / FOLDER)):
            pass  # that it cannot be written must not turn out after the walk

    def go(self) -> None:
        """Ask for the thing, look at the empty ground, then go from mark to mark, and along an arc."""
        for notice in self._judge.notices:
            print(notice)
        if self._unknown:
            print(f"How far it must be noticed is not known: {self._unknown}")
        print(_OPENING)
        self._distances()
        thing = self._ask("What is carried (for the record)?")
        self._zone = replace(self._zone, thing="".join(c for c in thing if c.isprintable())[:100])
        self._look_at_empty_ground()
        print(_KEYS)
        marks = [(line, at) for line in self._lines for at in reversed(self._zone.distances)]
        number = 0
        while number < len(marks):
            line, at = marks[number]
            key = self._measure(line, at)
            if key == "n":
                number = next((n for n in range(number, len(marks)) if marks[n][0] != line), len(marks))
            else:
                number = max(0, number - 1) if key == "b" else number + 1
        self._look_again()
        self._arc()

    def conclude(self) -> int:
        """Print the table and what it means, and write the files. Returns 1 where no mark was measured."""
        if not self._zone.marks:
            print("no mark was measured")
            return 1
        try:
            path = self._write()
        except OSError as error:
            print(f"not kept: {error}")
            path = None
        for text in table(self._zone, self._verdicts()):
            print(text)
        print(self._zone.verdict)
        if path is not None:
            print(f"{path}; measure again in other light")
        return 0

    def _verdicts(self) -> list[LineVerdict]:
        return verdicts(self._lines, self._zone.marks, self._zone.distances, self._stopping)

    def _write(self) -> Path:
        text, covers = conclusion(self._zone, self._lines, self._verdicts())
        self._zone = replace(self._zone, verdict=text, covers=covers)
        with as_owner(self._folder):
            return write_zone(self._folder, self._zone)

    def _distances(self) -> None:
        """Say where the marks are, and let the person type other distances."""
        while True:
            planned = self._zone.distances
            for line in self._lines:
                print(f"  {line.name:<11} {line.bearing:>6.1f}°  {_place(line, planned[-1])}")
            shown = " ".join(f"{one:g}" for one in planned)
            typed = self._ask(f"Distances in m (Enter takes {shown}):")
            if not typed:
                return
            found = typed_distances(typed, self._lines, self._needs)
            if found:
                self._zone = replace(self._zone, distances=found)
            else:
                print("  give metres between 0.1 and 100, as: 1 2 3.5")

    def _look_at_empty_ground(self) -> None:
        """Look until nothing in the view would stop the rover: else each mark would count as noticed."""
        while True:
            found = self._look_without("Go out of the view, with the thing. Enter:")
            if not found.raised:
                break
            print(
                f"  the empty ground would stop the rover in {found.noticed} of {found.count} frames "
                f"({', '.join(sorted(found.reasons))}): turn it to ground that its words describe, or see "
                "`companion setup`, page Words"
            )
        self._empty, empty = found, ZoneLook(**found.looked())
        self._zone = replace(self._zone, empty=empty)
        noticed = f"something noticed in {found.noticed} of {found.count} frames"
        print(f"  it would not stop: {noticed}; {light_text(empty)}")

    def _look_again(self) -> None:
        """Look at the empty ground once more: what stops the rover by now may have done so at each mark."""
        found = self._look_without("Go out of the view again, with the thing. Enter:")
        self._zone = replace(self._zone, clear=not found.raised)
        self._write()
        print(f"  it would {'stop for the empty ground by now' if found.raised else 'not stop'}")

    def _look_without(self, question: str) -> ZoneFrames:
        """Ask until a look at the ground succeeds."""
        while True:
            self._ask(question)
            try:
                return self._judge.watch()
            except NotMeasuredError as error:
                print(f"  not measured: {error}")

    def _measure(self, line: WalkLine, at: float) -> str:
        """Measure a mark until that succeeds, and return the key that was pressed."""
        while True:
            key = self._ask(f"{line.name}, {at:g} m ({_place(line, at)}):").lower()
            if key in ("n", "b"):
                return key
            if key and not self._waited(key):
                print(f"  {_KEYS}")
                continue
            try:
                found = self._judge.watch()
            except NotMeasuredError as error:
                print(f"  not measured: {error}")
                continue
            self._keep(line, at, found)
            return key

    def _waited(self, key: str) -> bool:
        """Wait for as many seconds as were typed. False for what is no such number."""
        if not (key.isascii() and key.isdigit() and len(key) <= 2 and int(key) <= _MOST_WAIT):
            return False
        time.sleep(int(key))
        return True

    def _keep(self, line: WalkLine, at: float, found: ZoneFrames) -> None:
        assert self._empty is not None
        thing = self._judge.new_thing(found, self._empty)
        metres, degrees, cell, _ = thing or NewThing()
        elsewhere = thing is not None and not thing.stands_at(at, line.bearing)
        mark = ZoneMark(
            **found.looked(),
            line=line.name,
            bearing_deg=line.bearing,
            distance_m=at,
            noticed=found.stops and thing is not None and not elsewhere,
            in_picture=thing is not None,
            elsewhere=elsewhere,
            ground_m=None if metres is None else round(metres, 2),
            ground_deg=None if degrees is None else round(degrees, 1),
        )
        others = (one for one in self._zone.marks if (one.line, one.distance_m) != (line.name, at))
        self._zone = replace(self._zone, marks=(*others, mark))
        self._write()
        where = "" if metres is None else f"{metres:.1f} m, {degrees:.0f}° (in cells of {cell:.1f} m)"
        by_mount = f", by the mount at {where}" if where else ""
        shown = "not seen in the picture" if thing is None else f"in the picture{by_mount}"
        stray = "" if mark.noticed or not found.stops else ", but not the thing on the mark"
        word = f"noticed{stray}" if found.stops else "NOT noticed"
        print(f"  {word}: {mark.noticed_frames} of {mark.frames} frames; {shown}; {light_text(mark)}\a")

    def _arc(self) -> None:
        """Measure a walk across the view at the distance in which the rover stops."""
        first, last = self._lines[0], self._lines[-1]
        needs = self._needs
        at = next((one for one in self._zone.distances if needs is None or one >= needs), None)
        if at is None:
            return
        span = f"along a circle of {at:g} m from {first.bearing:.0f}° to {last.bearing:.0f}°"
        if self._ask(f"Last, {span}: stand at its left end (n: leave it out):").lower() == "n":
            return
        print("  walk; Enter at the right end")
        try:
            found = self._judge.watch(lambda: self._typed.line(0.0) is None, ARC_LONGEST)
        except NotMeasuredError as error:
            print(f"  not measured: {error}")
            return
        arc = ZoneArc(**found.looked(), distance_m=at, from_deg=first.bearing, to_deg=last.bearing)
        self._zone = replace(self._zone, arcs=(arc,))

    def _ask(self, question: str) -> str:
        """Return what is typed. Raises EOFError at its end, for `q`, and after `LONGEST` s."""
        self._typed.forget()
        print(question, end=" ", flush=True)
        typed = self._typed.line(LONGEST)
        if typed is None or typed.lower() in ("q", "quit"):
            raise EOFError
        return typed


def _place(line: WalkLine, at: float) -> str:
    """Return a mark's place, in m."""
    ahead, right = line.point(at)
    return f"{ahead:.2f} ahead" + (f", {abs(right):.2f} {'right' if right > 0 else 'left'}" if right else "")
