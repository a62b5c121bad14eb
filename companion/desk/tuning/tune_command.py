"""Implements `companion tune`: thresholds and a region by which a drive calls as often as wanted."""

from __future__ import annotations

import json
import shlex
import sys
import time
from collections.abc import Mapping, Sequence
from html import escape
from pathlib import Path
from typing import Any

from anytraverse.evaluation.progress import doing
from anytraverse.evaluation.summary import as_csv
from anytraverse.html_page import document
from anytraverse.perception.stored import MOST_BYTES, default_cache
from anytraverse.plots import installed
from anytraverse.release import to_install
from companion.config import load_config
from companion.desk.drives.drive import DriveError
from companion.desk.drives.frames import open_drive
from companion.desk.tuning.choice import STYLE, Choice, OfferedSetting, parts
from companion.desk.tuning.episode import Episode, given_answers
from companion.desk.tuning.proposal import (
    MOST_WANTED,
    Candidate,
    changes,
    fragment,
    grid_of,
    in_time,
    named_times,
    proposed,
    refuse_short,
    warnings,
    weighed,
)
from companion.desk.tuning.report import csv_rows_of
from companion.desk.tuning.running import Where, figures_of, judge, perceive, processes_of
from companion.desk.tuning.trial import Combination
from companion.vision.warm_up import load_engine


def run(
    where: str,
    *,
    file: str,
    wanted: float,
    out: str,
    answers: str | None = None,
    keep_roi: bool = False,
    jobs: int = 0,
    cache: str | None = None,
) -> int:
    """Propose settings for a drive, and write what was found into the folder `out`. Returns 0.

    file: the configuration. wanted: calls a minute, at most. answers: a file of answers; None: those of a
    recording, else none. jobs: processes, 0: all cores. cache: folder of what was seen of frames.
    Raises DriveError, ConfigError, AnyTraverseError, OSError.
    """
    began = time.monotonic()
    if not 0.0 < wanted <= MOST_WANTED:
        raise DriveError(
            f"{wanted:g} calls a minute cannot be wanted: give a number above 0, at most {MOST_WANTED:g}"
        )
    config = load_config(file)
    with doing(f"opening {where}"):
        drive = open_drive(where, config.camera.rate)
    given = given_answers(drive, answers)
    episode = Episode(where, config.camera.rate, given)
    place = Where(Path(cache) if cache else default_cache(), MOST_BYTES, processes_of(jobs))
    folder = Path(out)
    folder.mkdir(parents=True, exist_ok=True)
    with doing(f"loading {config.perceiver.name}"):
        engine, _ = load_engine(config, None)
    settings = engine.settings
    now = Combination.of(settings)
    frames = perceive(config, episode, place)
    seen = figures_of(config, episode, place)
    if not seen.tiles:
        raise DriveError(f"{where} has no frame that can be judged: see what `companion rehearse` says of it")
    refuse_short(seen.seconds, wanted)
    grid = grid_of(
        seen.similarities,
        seen.uncertainties,
        seen.tiles,
        settings,
        [now.region] if keep_roi or settings.metres else (),
    )
    outcomes = judge(config, episode, grid.combinations(settings), place)
    named = named_times(given)
    candidates = [weighed(one, named, seen.seconds) for one in outcomes]
    before = next(one for one in candidates if one.combination == now)
    soon = in_time(candidates, now, settings, config)
    best = proposed(soon, now, wanted)
    kept = {id(one) for one in soon}
    rows = [
        {
            "number": number,
            **one.row(),
            "too_late": id(one) not in kept,
            "warnings": warnings(before, one, len(named)),
        }
        for number, one in enumerate(candidates)
    ]
    row_now, row_best = (rows[candidates.index(one)] for one in (before, best))
    figures: dict[str, Any] = {
        "drive": drive.title,
        "model": engine.perceiver.model_id,
        "prompts": config.preferences.format(),
        "frames": frames,
        "drive_s": round(seen.seconds, 1),
        "wanted": wanted,
        "named": len(named),
        "combinations": len(candidates),
        "too_late": len(candidates) - len(soon),
        "now": row_now,
        "proposed": row_best,
        "reached": best.rate <= wanted,
        "seconds": round(time.monotonic() - began, 1),
        "warnings": row_best["warnings"],
    }
    remarks = _remarks(figures)
    toml = fragment(best.combination, now, remarks)
    shown = [
        _setting(rows[number], one, now, figures)
        for number, one in enumerate(candidates)
        if not rows[number]["too_late"]
    ]
    choice = Choice(
        sorted(shown, key=lambda one: (changes(one.combination, now), one.number)),
        None if row_now["too_late"] else row_now["number"],
        row_best["number"],
        "calls a minute",
        "named things noticed" if named else "times that it would be held",
        f"{frames} frames, {seen.seconds:.0f} s" + (f", {len(named)} named" if named else ""),
        f"companion tune --take {{}} --from {shlex.quote(str(folder / 'tuning.json'))} "
        f"--write {shlex.quote(file)}",
        most=len(named) or None,
        wanted=wanted,
    )
    for name, text in (
        ("tuned.toml", toml),
        ("tuning.csv", as_csv(csv_rows_of([_cells(row) for row in rows]))),
        ("tuning.json", json.dumps({**figures, "each": rows}) + "\n"),
        ("tuning.html", _page(figures, choice, remarks)),
    ):
        (folder / name).write_text(text, encoding="utf-8")
    for line in remarks:
        print(line)
    print(
        f"{folder / 'tuned.toml'} has what to put into {file}; {folder / 'tuning.html'} lets you take another"
    )
    if not installed():
        print(f"tuning.html has no plot: {to_install('plots')}", file=sys.stderr)
    print(json.dumps(figures))
    return 0


def _remarks(figures: dict[str, Any]) -> list[str]:
    """Return what was found, for a person."""
    now, best, named = figures["now"], figures["proposed"], figures["named"]
    lines = [
        f"companion tune: {figures['drive']}, {figures['frames']} frames, {figures['drive_s']:g} s, "
        f"{figures['combinations']} combinations",
        f"calls a minute: {now['calls_per_minute']:.2f} now, {best['calls_per_minute']:.2f} proposed, "
        f"{figures['wanted']:g} wanted at most",
    ]
    if not figures["reached"]:
        lines.append("no combination calls as rarely: this one calls least. Teach words, or more places")
    if named:
        lines.append(
            f"things that somebody named: {named}; of these call {now['kept']} now, {best['kept']} proposed"
        )
    else:
        lines.append(
            "WARNING: no answers were given, so nothing tells which calls matter, and the proposal may "
            "silence those that do: rehearse the drive first"
        )
    if figures["too_late"]:
        lines.append(
            f"{figures['too_late']} combinations are left out: by them a thing is seen too late to stop"
        )
    lines += figures["warnings"]
    if best == now:
        lines.append("the settings in force are the best of these")
    lines.append("this fits one drive: rehearse another with it before you trust it")
    return lines


def _setting(
    row: Mapping[str, Any], one: Candidate, now: Combination, figures: Mapping[str, Any]
) -> OfferedSetting:
    """Return a candidate as it is shown to choose from. row: of the JSON."""
    number, named = row["number"], figures["named"]
    return OfferedSetting(
        number,
        one.combination,
        row["calls_per_minute"],
        one.kept if named else one.holds,
        fragment(one.combination, now, [f"companion tune: {figures['drive']}, setting {number}"]),
        {"would_be_held": one.holds, "first_half": one.halves[0], "second_half": one.halves[1]},
        row["warnings"],
    )


def _cells(row: Mapping[str, Any]) -> dict[str, Any]:
    """Return a row for the CSV."""
    return {key: value for key, value in row.items() if key != "warnings"}


def _page(figures: Mapping[str, Any], choice: Choice, remarks: Sequence[str]) -> str:
    """Return the page: what is proposed, and what else can be chosen."""
    told = (line for line in remarks[1:] if line not in figures["warnings"])  # those stand at the setting
    head = [f"<h1>Tuning on {escape(figures['drive'])}</h1>"]
    head += [f"<p{_class(line)}>{escape(line)}</p>" for line in told]
    return document(f"Tuning on {figures['drive']}", STYLE, [*head, *parts(choice)])


def _class(line: str) -> str:
    return ' class="warning"' if line.startswith("WARNING") else ""
