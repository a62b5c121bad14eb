"""Sets modes by hand, -200 to +200 ms round the companion's holds and resumes, over a wire with a delay.

With the script on the autopilot and without it, idle and beside two busy loops. Prints a line a trial; the
last line is one JSON object, also when it is ended early. The exit code is 1 if a human was overridden where
the script runs, or drove in our mode for longer than the round trip and half a second where it does not.
With --guide modes and targets come round the hand-over of guiding, in virtual time: see `guided`.
Run: make bench-modes, or python -m bench.modes [--trials 208] [--delay 0 500] [--busy no]
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import signal
import subprocess
import sys
import tempfile
import threading
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor, as_completed
from contextlib import contextmanager
from pathlib import Path

from bench.modes import guided
from bench.modes.judging import ModeOutcome, ModeSetting, figures, line
from bench.modes.trials import play_all

DELAYS, QUICK_DELAYS = (0, 20, 100, 500), (20,)
TRIALS, QUICK_TRIALS, GUIDED_TRIALS = 208, 4, 200
BOTH = {"no": (False,), "yes": (True,), "both": (False, True)}
LOOPS = 2


def main() -> int:
    given = _arguments()
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _end)
    if given.guide:
        return _guide(given.trials, given.jobs, given.seed)
    settings = [
        ModeSetting(script, delay / 1000, busy, given.brakes)
        for busy in BOTH[given.busy]
        for delay in given.delay
        for script in BOTH[given.script]
    ]
    share, more = divmod(given.trials, len(settings))
    todo = [(setting, share + (place < more)) for place, setting in enumerate(settings)]
    cancelled = threading.Event()
    outcomes: list[ModeOutcome] = []
    void: list[str] = []

    def one(setting: ModeSetting, number: int) -> None:
        name = f"{'script' if setting.script else 'none'}-{round(1000 * setting.delay)}"
        folder = out / f"{name}-{'busy' if setting.busy else 'idle'}"
        for found in play_all(setting, number, given.seed, folder, cancelled):
            if isinstance(found, str):
                void.append(found)
                print(f"void: {found}", flush=True)
            else:
                outcomes.append(found)
                print(line(found), flush=True)

    with tempfile.TemporaryDirectory(prefix="modes-", ignore_cleanup_errors=True) as folder:
        out = given.out or Path(folder)
        try:
            for busy in BOTH[given.busy]:
                now = [(setting, number) for setting, number in todo if setting.busy is busy and number]
                with _loops(LOOPS * busy), ThreadPoolExecutor(given.jobs) as pool:
                    try:
                        for future in [pool.submit(one, *each) for each in now]:
                            future.result()
                    except BaseException:
                        cancelled.set()
                        pool.shutdown(wait=False, cancel_futures=True)
                        raise
        finally:
            print(json.dumps(figures(outcomes, len(void))), flush=True)
    return 0 if outcomes and all(outcome.good for outcome in outcomes) else 1


def _guide(trials: int, jobs: int, seed: int) -> int:
    """Plays the trials of guiding in processes of their own, since each has its own time."""
    outcomes: list[guided.GuidedOutcome] = []
    without = 0
    pool = ProcessPoolExecutor(jobs, multiprocessing.get_context("spawn"))
    try:
        todo = []
        for number, begun in enumerate(range(0, trials, guided.TOGETHER)):
            delay = guided.DELAYS[number % len(guided.DELAYS)]
            count = min(guided.TOGETHER, trials - begun)
            todo.append(pool.submit(guided.play_all, delay, count, f"{seed} {number}"))
        for future in as_completed(todo):
            found, why = future.result()
            without += bool(why)
            outcomes += found
            for text in [guided.line(one) for one in found] or [why]:
                print(text, flush=True)
    finally:
        pool.shutdown(wait=False, cancel_futures=True)
        print(json.dumps(guided.figures(outcomes, without)), flush=True)
    return 0 if outcomes and not without and not any(one.overridden for one in outcomes) else 1


@contextmanager
def _loops(number: int) -> Iterator[None]:
    """Keeps so many cores busy."""
    busy = [subprocess.Popen([sys.executable, "-c", "while True: pass"]) for _ in range(number)]
    try:
        yield
    finally:
        for process in busy:
            process.kill()
            process.wait()


def _end(number: int, _frame: object) -> None:
    raise SystemExit(128 + number)


def _arguments() -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m bench.modes", description=__doc__)
    parser.add_argument("--trials", type=int, help=f"in all (default {TRIALS})")
    parser.add_argument("--delay", type=int, nargs="+", metavar="MS", help="of the wire, each way")
    parser.add_argument("--busy", choices=list(BOTH), help="beside two busy loops (default both)")
    parser.add_argument("--script", choices=list(BOTH), default="both", help="there (default both)")
    parser.add_argument("--jobs", type=int, default=2, help="rovers side by side (default 2)")
    parser.add_argument("--seed", type=int, default=1, help="of everything that is random (default 1)")
    parser.add_argument("--brakes", action="store_true", help="the script brakes before HOLD; holds alone")
    parser.add_argument(
        "--guide", action="store_true", help="round the hand-over of guiding, and nothing else"
    )
    parser.add_argument(
        "--quick", action="store_true", help=f"{QUICK_TRIALS} trials, one delay, no busy loops"
    )
    parser.add_argument("--out", type=Path, metavar="FOLDER", help="where logs are kept; else thrown away")
    given = parser.parse_args()
    trials = GUIDED_TRIALS if given.guide else TRIALS
    given.trials = given.trials or (QUICK_TRIALS if given.quick else trials)
    given.delay = given.delay or list(QUICK_DELAYS if given.quick else DELAYS)
    given.script = "yes" if given.brakes else given.script
    given.busy = given.busy or ("no" if given.quick else "both")
    return given


if __name__ == "__main__":
    sys.exit(main())
