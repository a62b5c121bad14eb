"""Implements `companion tune`: thresholds and a region by which a drive calls as often as wanted."""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from html import escape
from pathlib import Path
from typing import Any

from anytraverse.evaluation.progress import doing
from anytraverse.evaluation.summary import as_csv
from anytraverse.html_page import document
from anytraverse.line_plot import STYLE, Series, line_plot
from anytraverse.perception.stored import MOST_BYTES, default_cache
from companion.config import load_config
from companion.desk.drives.drive import DriveError
from companion.desk.drives.frames import open_drive
from companion.desk.tuning.episode import Episode, given_answers
from companion.desk.tuning.proposal import (
    MOST_WANTED,
    Candidate,
    fragment,
    frontier,
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
        settings = load_engine(config, None)[0].settings
    now = Combination.of(settings)
    frames = perceive(config, episode, place)
    seen = figures_of(config, episode, place)
    if not seen.tiles:
        raise DriveError(f"{where} has no frame that can be judged: see what `companion rehearse` says of it")
    refuse_short(seen.seconds, wanted)
    grid = grid_of(
        seen.similarities, seen.uncertainties, seen.tiles, settings, [now.region] if keep_roi else ()
    )
    outcomes = judge(config, episode, grid.combinations(settings), place)
    named = named_times(given)
    candidates = [weighed(one, named, seen.seconds) for one in outcomes]
    before = next(one for one in candidates if one.combination == now)
    soon = in_time(candidates, now, settings, config)
    best = proposed(soon, now, wanted)
    figures: dict[str, Any] = {
        "drive": drive.title,
        "frames": frames,
        "drive_s": round(seen.seconds, 1),
        "wanted": wanted,
        "named": len(named),
        "combinations": len(candidates),
        "too_late": len(candidates) - len(soon),
        "now": before.row(),
        "proposed": best.row(),
        "reached": best.rate <= wanted,
        "seconds": round(time.monotonic() - began, 1),
        "warnings": warnings(before, best, len(named)),
    }
    remarks = _remarks(figures)
    toml = fragment(best.combination, now, remarks)
    rows = [one.row() for one in candidates]
    for name, text in (
        ("tuned.toml", toml),
        ("tuning.csv", as_csv(csv_rows_of(rows))),
        ("tuning.json", json.dumps({**figures, "each": rows}) + "\n"),
        ("tuning.html", _page(figures, candidates, before, best, toml, remarks)),
    ):
        (folder / name).write_text(text, encoding="utf-8")
    for line in remarks:
        print(line)
    print(f"{folder / 'tuned.toml'} has what to put into {file}; {folder / 'tuning.html'} shows the others")
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


def _page(
    figures: dict[str, Any],
    candidates: Sequence[Candidate],
    before: Candidate,
    best: Candidate,
    toml: str,
    remarks: Sequence[str],
) -> str:
    """Return the page: what is proposed, and what it was chosen from."""
    parts = [
        f"<h1>Tuning on {escape(figures['drive'])}</h1>",
        *(f"<p{_class(line)}>{escape(line)}</p>" for line in remarks[1:]),
        f"<h2>To put into companion.toml</h2><pre>{escape(toml)}</pre>",
    ]
    most = max(one.rate for one in candidates) or 1.0
    if figures["named"]:
        named = figures["named"]

        def at(one: Candidate) -> tuple[float, float]:
            return one.rate, one.kept / named

        spots = sorted({at(one) for one in candidates})
        parts += [
            "<h2>Calls, and named things that still call</h2>",
            '<p class="faint">Each dot is a combination. Up: the share of the named things near which it '
            "calls. The line joins those that none surpasses; the dashes are the wanted rate.</p>",
            line_plot(
                [
                    Series("", "--grey", spots, dots=True),
                    Series("", "--blue", [at(one) for one in frontier(candidates)]),
                    Series("now", "--red", [at(before)], dots=True),
                    Series("proposed", "--green", [at(best)], dots=True),
                ],
                "calls a minute",
                x=(0.0, most),
                mark=figures["wanted"],
            ),
        ]
    parts.append("<h2>Calls a minute over each threshold</h2>")
    parts.append(
        '<p class="faint">The others as proposed. Dashes: the proposed value.</p><div class="plots">'
    )
    for name in ("scene", "roi", "tile"):
        drawn = _over(name, candidates, best, most)
        parts.append(f"<div><h3>{name}</h3>{drawn}</div>" if drawn else "")
    parts.append("</div>")
    return document(f"Tuning on {figures['drive']}", STYLE + _STYLE, parts)


def _class(line: str) -> str:
    return ' class="warning"' if line.startswith("WARNING") else ""


_STYLE = """
.warning { border-left: 4px solid var(--red); padding-left: .6rem; font-weight: 600; }
.plots { display: grid; gap: 1rem; grid-template-columns: repeat(auto-fit, minmax(18rem, 1fr)); }
pre { overflow-x: auto; padding: .6rem; border: 1px solid var(--line); }
"""


def _over(name: str, candidates: Sequence[Candidate], best: Candidate, most: float) -> str:
    """Draw the rate over one threshold; "" where it has but one value."""
    others = [one for one in ("scene", "roi", "tile", "region") if one != name]
    points = sorted(
        (value, one.rate)
        for one in candidates
        if (value := getattr(one.combination, name)) is not None
        and all(getattr(one.combination, key) == getattr(best.combination, key) for key in others)
    )
    if len(points) < 2:
        return ""
    span = (points[0][0], points[-1][0])
    line = [Series("", "--blue", points), Series("", "--blue", points, dots=True)]
    mark = getattr(best.combination, name)
    return line_plot(line, name, x=span, y=(0.0, most), mark=mark, size=(240, 160))
