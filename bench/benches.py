"""Lists all benchmarks: what each measures, how it is started, how long it takes, what it needs.

Tools that a person reads are not listed: `cutouts`, `labelled_field`, `still_pictures`, `worst_frames`.
"""

from __future__ import annotations

import shutil
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from importlib.util import find_spec
from pathlib import Path

from bench.result import Quoted

OUT = "@out@"
"""In an argument: the folder of the results."""
LESS, MORE = "less", "more"


@dataclass(frozen=True)
class Bench:
    """Describes a benchmark, whose last line of output is one JSON object.

    arguments, quick: of its two forms; None: there is no quick one. minutes: that each takes, about. needs:
    returns what is missing here and how to get it, "" for nothing. figures: quoted from its last line.
    """

    module: str
    measures: str
    minutes: tuple[float, float]
    arguments: tuple[str, ...] = ()
    quick: tuple[str, ...] | None = None
    needs: Callable[[], str] = str
    figures: tuple[Quoted, ...] = ()


def _packages(*names: str, extra: str) -> str:
    missing = [name for name in names if find_spec(name) is None]
    return f'needs {", ".join(missing)}: pip install "anytraverse-companion[{extra}]"' if missing else ""


def _browser() -> str:
    from bench.console.stage import CHROMIUM

    missing = [] if find_spec("playwright") else ["Playwright (pip install playwright)"]
    missing += [] if Path(CHROMIUM).exists() else [f"Chromium as {CHROMIUM}"]
    return f"needs {' and '.join(missing)}" if missing else ""


def _frames() -> str:
    from bench.perception.frames import DATA

    return "" if (DATA / "trail").is_dir() else f"needs the labelled frames trail/ and abroad/ in {DATA}"


def _compiler() -> str:
    return "" if shutil.which("cc") else "needs a C compiler: sudo apt install gcc"


def _rtsp() -> str:
    from bench.cameras.servers import rtsp_missing

    return rtsp_missing()


def _root() -> str:
    from bench.service.container import ContainerError, require

    try:
        require()
    except ContainerError as error:
        return str(error)
    return ""


def _camera(kind: str, needs: Callable[[], str] = str) -> Bench:
    return Bench(
        "bench.cameras",
        f"a camera that is lost again and again ({kind}): when that is noticed, when its pictures are back",
        (7, 0.2),
        ("--kind", kind),
        ("--kind", kind, "--losses", "3"),
        needs,
        (
            Quoted("noticed_s/max", "noticed, the latest", "s", LESS),
            Quoted("back_s/p50", "back, median", "s", LESS),
            Quoted("back_s/max", "back, the latest", "s", LESS),
            Quoted("stale", "stale pictures taken for fresh", "", LESS),
        ),
    )


def _growth(part: str, measures: str, minutes: tuple[float, float], *figures: Quoted) -> Bench:
    return Bench("bench.growth", measures, minutes, (part,), (part, "--quick"), figures=figures)


def _ratio(key: str, what: str) -> Quoted:
    return Quoted(key, what, "times as fast as the authors'", MORE, f"{key}_quartiles")


def _rise(name: str, what: str, unit: str, over: str = "per 100,000 frames") -> Quoted:
    return Quoted(f"rise/{name}/value", what, f"{unit} {over}", LESS, f"rise/{name}/interval")


_LINK = (
    Quoted("lossy/all of it/lost", "calls lost over a bad radio", "", LESS),
    Quoted("lossy/all of it/twice", "calls answered twice over a bad radio", "", LESS),
    Quoted("lossy/all of it/known_s/p99", "the operator knows the outcome over a bad radio, 99 %", "s", LESS),
    Quoted("speed/handled/us_a_frame", "a MAVLink frame handled", "µs of CPU", LESS),
    Quoted("speed/share_at_1_hz", "the link at one summary/s", "% of a core", LESS),
    Quoted("speed/seeing_at_1_hz/judged_to_wire_ms/p99", "from judged to the wire, 99 %", "ms", LESS),
)
_PERCEPTION = (
    Quoted("iou_home", "drivable IoU, home", "", MORE),
    Quoted("iou_abroad", "drivable IoU, abroad", "", MORE),
    Quoted("false_home", "clean frames stopped, home", "", LESS),
    Quoted("false_abroad", "clean frames stopped, abroad", "", LESS),
    Quoted("noticed_abroad", "real things noticed, abroad", "", MORE),
    Quoted("missed_large", "large pasted things never noticed", "", LESS),
    Quoted("missed_small", "small pasted things never noticed", "", LESS),
)

_CALLS = (
    *(
        Quoted(f"trail/{name}/calls_per_100m", f"simulated trail, {name}", "calls per 100 m", LESS)
        for name in ("go", "word", "tap")
    ),
    *(Quoted(f"trail/{name}/repeats", f"of them asked again, {name}", "", LESS) for name in ("go", "tap")),
    Quoted("real/word/calls_per_100", "real frames, words", "calls per 100 frames", LESS),
    Quoted("real/word/second_pass_per_100", "the same frames again", "calls per 100 frames", LESS),
)
_FIELD_DRIVE = (
    *(
        Quoted(f"{name}/contacts", f"things touched that could be seen in time, {name}", "", LESS)
        for name in ("hold", "guide")
    ),
    *(
        Quoted(f"{name}/route_share", f"share of the routes that was driven, {name}", "", MORE)
        for name in ("hold", "guide")
    ),
    Quoted("guide/passed_share", "things with room that were passed without a call", "", MORE),
    *(
        Quoted(f"{name}/needless_stops_per_100m", f"stops for nothing, {name}", "per 100 m", LESS)
        for name in ("hold", "guide")
    ),
)

BENCHES = {
    "growth-words": _growth("words", "a frame by the number of words, 1 to 16: time and memory", (3, 0.3)),
    "growth-history": _growth("history", "what 10 to 10,000 remembered scenes cost", (2, 0.4)),
    "growth-sizes": _growth("sizes", "a frame and its pictures by size, 320x240 to 3840x2160", (1, 0.3)),
    "growth-hours": _growth(
        "hours",
        "an hour's frames of the daemon in virtual time: whether memory, disk or times rise",
        (12, 0.4),
        _rise("own memory", "memory rises", "MB"),
        _rise("journal, log, calls, pictures", "files rise", "MB"),
        _rise("judged", "a judged frame rises", "times the yardstick"),
        _rise("turns of the daemon", "the daemon's turns rise", "times the yardstick"),
    ),
    "growth-daemon": Bench(
        "bench.growth",
        "a whole daemon in real time, with calls, a page and a recording: whether its main process grows",
        (61, 0),
        ("daemon",),
        figures=(_rise("main process, own memory", "its own memory rises", "MB", "an hour"),),
    ),
    "cost": Bench(
        "bench.perception.cost",
        "a frame of the built-in network on one core, with ten words of which two tapped: time and memory",
        (0.1, 0.1),
        quick=("--frames", "40"),
        figures=(
            Quoted("ms_frame", "a frame, median", "ms of CPU", LESS),
            Quoted("ms_frame_p95", "a frame, 95 %", "ms of CPU", LESS),
            Quoted("peak_rss_mb", "peak memory", "MB", LESS),
        ),
    ),
    "clipseg": Bench(
        "bench.clipseg",
        "bundles of any word against the authors' step: time and memory, with random weights",
        (40, 0),
        ("--out", OUT),
        needs=partial(_packages, "torch", "transformers", "onnx", extra="export"),
        figures=(
            _ratio("ratio_fp32_k4", "fp32, four words"),
            _ratio("ratio_int8_k4", "int8, four words"),
            Quoted("rss_mb_fp32", "peak memory, fp32", "MB", LESS),
            Quoted("rss_mb_int8", "peak memory, int8", "MB", LESS),
        ),
    ),
    "perception": Bench(
        "bench.perception",
        "how far the built-in network may be trusted, at home and abroad",
        (3, 0.3),
        ("--out", f"{OUT}/perception-figures.json"),
        ("--only", "ground", "scenes"),
        _frames,
        _PERCEPTION,
    ),
    "ground": Bench(
        "bench.ground",
        "how well the ground is known in metres, by a frame while the rover swings and by the grid; cost",
        (16, 0.5),
        quick=("--quick",),
        figures=(
            Quoted("obstacle_recall", "cells of obstacles that the grid does not take for free", "", MORE),
            Quoted("false_blocks", "free cells that the grid takes for blocked", "", LESS),
            Quoted("ms_p50", "an update of the grid, median", "ms of CPU", LESS),
            Quoted("range_error_90/4", "error at 4 m, a swing of 2 degrees, 90 %", "m", LESS),
            Quoted("range_error_90/5", "error at 5 m, a swing of 2 degrees, 90 %", "m", LESS),
            Quoted("ms_metres_50", "the figures of a region in metres, median", "ms of CPU", LESS),
        ),
    ),
    "field-drive": Bench(
        "bench.field_drive",
        "random trails with things on them under each policy: contacts, how far it comes, what it asks",
        (50, 3),
        quick=("--runs", "2"),
        figures=_FIELD_DRIVE,
    ),
    "false-stops": Bench(
        "bench.false_stops",
        "clean frames of held-out drives that are not OK",
        (1, 0),
        (
            "../shared/data/trail",
            "--drivable",
            "smooth_trail,rough_trail,grass",
            "--unlabelled",
            "../shared/data/sequence",
        ),
        needs=_frames,
        figures=(Quoted("not_ok/clean 0.85", "of 100 clean frames not OK", "", LESS),),
    ),
    "field-goal": Bench(
        "bench.field_goal",
        "simulated trails: things that are called for, and false calls",
        (15, 0),
        figures=(
            Quoted("missed", "things missed", "", LESS),
            Quoted("false_per_100", "false calls per 100 familiar frames", "", LESS),
        ),
    ),
    "field-frames": Bench(
        "bench.field_frames",
        "a frame of the simulated trail",
        (0.6, 0),
        figures=(
            Quoted("320x240/ms", "320x240, mean", "ms of CPU", LESS),
            Quoted("640x480/ms", "640x480, mean", "ms of CPU", LESS),
        ),
    ),
    "link": Bench(
        "bench.link",
        "a bad radio, a million mutated frames, floods, and how fast the link is",
        (12, 0.6),
        quick=("lossy", "udp", "speed", "--calls", "4", "--seconds", "1"),
        figures=_LINK,
    ),
    "vision": Bench(
        "bench.vision.kills",
        "the vision process killed between answers and their acknowledgements",
        (3, 0.1),
        quick=("--kills", "5"),
        figures=(
            Quoted("lost", "answers lost", "", LESS),
            Quoted("twice", "answers applied twice", "", LESS),
            Quoted("return_s/p50", "vision is back, median", "s", LESS),
            Quoted("return_s/max", "vision is back, the latest", "s", LESS),
        ),
    ),
    "cameras-pipe": _camera("pipe"),
    "cameras-http": _camera("http"),
    "cameras-rtsp": _camera("rtsp", _rtsp),
    "stopping": Bench(
        "bench.stopping",
        "faults made on purpose while a simulated rover drives: seconds and metres until it stands",
        (40, 0),
        figures=(
            Quoted("worst_seconds", "from the fault to standing, the latest", "s", LESS),
            Quoted("worst_metres", "from the fault to standing, the farthest", "m", LESS),
            Quoted("commanded_in_report_policy", "commands in policy report", "", LESS),
        ),
    ),
    "modes": Bench(
        "bench.modes",
        "modes set by hand round the companion's mode commands, over a wire with a delay: who is overridden",
        (10, 0.3),
        quick=("--quick",),
        figures=(
            Quoted("overridden_with_script", "humans overridden, with the script", "", LESS),
            Quoted("overridden_without", "humans overridden, without it", "", LESS),
            Quoted("longest_override_s", "our driving mode stood over a human's, the longest", "s", LESS),
        ),
    ),
    "attack": Bench(
        "bench.attack",
        "floods, forged names, hostile rovers, cameras and recordings: what is reached, and what suffers",
        (9, 4),
        figures=(
            Quoted("worst_heartbeat_gap_s", "between two heartbeats, the longest", "s", LESS),
            Quoted("longest_without_judging_s", "without a judged frame, the longest", "s", LESS),
            Quoted("reached", "what an attacker got at", "", LESS),
            Quoted("secrets", "secrets that were read", "", LESS),
        ),
    ),
    "calls": Bench(
        "bench.calls",
        "drives in virtual time, answered by go, words or taps: how many calls, and how many ask again",
        (60, 0),
        ("--out", f"{OUT}/calls-figures.json"),
        figures=_CALLS,
    ),
    "faults": Bench(
        "bench.faults",
        "every fault of docs/faults.md: what follows it, when it holds, when it is back",
        (75, 0.5),
        quick=("--short", "--only", "camera frozen"),
        needs=_compiler,
        figures=(
            Quoted("safe", "faults that ended safely", "", MORE),
            Quoted("worst_hold_s", "hold, the latest", "s", LESS),
            Quoted("worst_return_s", "return, the latest", "s", LESS),
        ),
    ),
    "power": Bench(
        "bench.faults.power_loss",
        "the companion killed at points of its writes, and its power cut: what its journal has then",
        (5, 0.2),
        quick=("--kills", "8", "--cuts", "25"),
        needs=_compiler,
        figures=(Quoted("killed/changes", "changes of files in a drive", ""),),
    ),
    "recording": Bench(
        "bench.recording",
        "what recording costs: CPU of each process, bytes, judging rate, latency",
        (20, 0),
        ("--frames", "../shared/data/sequence", "--rounds", "5"),
        needs=_frames,
    ),
    "console": Bench(
        "bench.console",
        "calls of a simulated rover answered in a browser: how many actions an answer takes",
        (3, 0),
        needs=_browser,
        figures=(
            Quoted("actions/go/median", "go", "actions", LESS),
            Quoted("actions/tap and name/median", "tap and name", "actions", LESS),
        ),
    ),
    "console-latency": Bench(
        "bench.console.latency",
        "how soon the console shows a call",
        (1, 0.5),
        quick=("--calls", "20"),
        needs=_browser,
        figures=(
            Quoted("ms/p50", "from the radio to the page, median", "ms", LESS),
            Quoted("ms/p99", "from the radio to the page, 99 %", "ms", LESS),
        ),
    ),
    "console-radio": Bench(
        "bench.console.radio",
        "calls answered in a browser over a simulated radio",
        (3, 0),
        needs=_browser,
    ),
    "service": Bench(
        "bench.service",
        "the installed service in a booted Debian: install, kill, hang, upgrade, devices",
        (15, 0),
        needs=_root,
        figures=(
            Quoted("install/install_s", "install", "s", LESS),
            Quoted("reboot/sees_after_s", "after a boot the first frame is judged", "s", LESS),
            Quoted("hang/back_s", "back after a hang", "s", LESS),
        ),
    ),
    "mutants": Bench(
        "bench.mutants",
        "faults put into the safety path one at a time: whether the tests notice",
        (240, 0),
        figures=(Quoted("mutants", "mutants", ""), Quoted("caught", "caught by the tests", "", MORE)),
    ),
    "house": Bench(
        "bench.house",
        "how simple the code is: lines, files, floors of imports, files that an event passes",
        (0.3, 0.3),
        quick=(),
        figures=(
            Quoted("floors", "floors of imports", "", LESS),
            Quoted("frame to summary/files", "files from a frame to its summary", "", LESS),
            Quoted("fault to hold/files", "files from a fault to its hold", "", LESS),
        ),
    ),
}
"""Name -> benchmark, in the order in which they run."""


def chosen(names: list[str]) -> dict[str, Bench]:
    """Returns those of these names, or that begin with one and "-"; all for none. Raises ValueError."""
    found: dict[str, Bench] = {}
    for name in names or list(BENCHES):
        own = {key: one for key, one in BENCHES.items() if key == name or key.startswith(f"{name}-")}
        if not own:
            raise ValueError(f"no benchmark is called {name}: give some of {', '.join(BENCHES)}")
        found |= own
    return found
