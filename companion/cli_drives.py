"""The commands for drives at the desk."""

from __future__ import annotations

import argparse
import logging
import sys
from collections.abc import Callable
from contextlib import suppress
from typing import TYPE_CHECKING

from companion.cli_config import add_config, default_config
from companion.cli_errors import UserError, told
from companion.system.log_lines import log_to_stderr

if TYPE_CHECKING:
    Commands = argparse._SubParsersAction[argparse.ArgumentParser]


def add_drives(commands: Commands) -> None:
    """Add look-ground, costmap, rehearse, replay and tune."""
    _add_look_ground(commands)
    _add_costmap(commands)
    _add_rehearse(commands)
    _add_replay(commands)
    _add_tune(commands)


def _add_look_ground(commands: Commands) -> None:
    look = commands.add_parser("look-ground", help="draw into a picture where [mount] puts the ground")
    look.add_argument("picture", metavar="PICTURE", help="of the rover's camera; of a drive its first frame")
    add_config(look)
    look.add_argument("--out", default="ground.png", metavar="PNG", help="by default ./%(default)s")
    look.add_argument(
        "--estimate", action="store_true", help="of a drive: propose height and tilt, and draw nothing"
    )
    look.add_argument(
        "--speed",
        type=_number(0.05, 30.0, "is no speed in m/s: give 0.05 to 30"),
        metavar="N",
        help="m/s at which a video or pictures were driven straight",
    )
    look.set_defaults(run=_look_ground)


def _number(low: float, high: float, otherwise: str) -> Callable[[str], float]:
    """Return what reads a number from low to high. otherwise: what to say of another text, behind it."""

    def read(text: str) -> float:
        with suppress(ValueError):
            if low <= float(text) <= high:
                return float(text)
        raise argparse.ArgumentTypeError(f"{text} {otherwise}")

    return read


def _add_costmap(commands: Commands) -> None:
    costmap = commands.add_parser("costmap", help="write what a recorded drive knew of the ground around it")
    costmap.add_argument("recording", metavar="RECORDING", help="a file *.mcap, or a folder with some")
    costmap.add_argument("--config", default="", metavar="FILE", help="by default the recording's")
    costmap.add_argument("--out", default="costmap", metavar="FOLDER", help="by default ./%(default)s")
    costmap.add_argument(
        "--at",
        type=_number(0.0, 1e9, "are no seconds of a drive: give 0 or more"),
        metavar="SECONDS",
        help="after the first frame, by default at the end",
    )
    costmap.set_defaults(run=_costmap)


def _add_rehearse(commands: Commands) -> None:
    rehearse = commands.add_parser("rehearse", help="say which calls a drive would raise, and answer them")
    rehearse.add_argument("drive", metavar="DRIVE", help="a folder of pictures, a video, or a recording")
    add_config(rehearse)
    rehearse.add_argument("--out", default="rehearsal", metavar="FOLDER", help="by default ./%(default)s")
    rehearse.add_argument("--answers", metavar="FILE", help="answers, as an earlier rehearsal wrote them")
    rehearse.add_argument(
        "--memory", metavar="FILE", help="scenes to start with, of `companion memory export`"
    )
    rehearse.add_argument("--no-ask", action="store_true", help="ask nobody")
    rehearse.add_argument("--browser", action="store_true", help="ask in a browser, not at the terminal")
    rehearse.add_argument("--port", type=int, default=0, help="of that page; by default any free one")
    rehearse.set_defaults(run=_rehearse)


def _add_replay(commands: Commands) -> None:
    replay = commands.add_parser("replay", help="judge a drive again, and say what differs from before")
    replay.add_argument("drive", metavar="DRIVE", help="a recording, a folder of pictures, or a video")
    replay.add_argument(
        "--config", default="", metavar="FILE", help="by default the recording's, else as for other commands"
    )
    replay.add_argument("--refs", metavar="FILE", help="references, by default DRIVE.refs.jsonl")
    replay.add_argument("--update-refs", action="store_true", help="write the references anew")
    replay.set_defaults(run=_replay)


def _add_tune(commands: Commands) -> None:
    tune = commands.add_parser(
        "tune", help="propose thresholds and a region by which a drive calls as wanted"
    )
    tune.add_argument(
        "drive", nargs="?", metavar="DRIVE", help="a recording, a folder of pictures, or a video"
    )
    add_config(tune)
    tune.add_argument(
        "--calls-per-minute", type=float, default=1.0, metavar="N", help="at most, by default %(default)g"
    )
    tune.add_argument(
        "--answers", metavar="FILE", help="of `companion rehearse`; of a recording those that were recorded"
    )
    tune.add_argument("--keep-roi", action="store_true", help="leave the region of interest as it is")
    tune.add_argument("--out", default="tuning", metavar="FOLDER", help="by default ./%(default)s")
    tune.add_argument("--jobs", type=int, default=0, metavar="N", help="processes, by default all cores")
    tune.add_argument(
        "--cache", metavar="DIR", help="what was seen of frames, by default ~/.cache/anytraverse"
    )
    tune.add_argument(
        "--take", type=int, metavar="N", help="judge nothing: say what setting N of an earlier run changes"
    )
    tune.add_argument(
        "--from",
        dest="source",
        metavar="FILE",
        help="with --take: tuning.json or calls.json, by default in --out",
    )
    tune.add_argument("--write", metavar="FILE", help="with --take: write it into this companion.toml")
    tune.set_defaults(run=_tune)


def _look_ground(options: argparse.Namespace) -> int:
    if options.estimate:
        from companion.desk.ground.mount_estimate import estimate

        return _of_drives(lambda: estimate(options.picture, file=options.config, speed=options.speed))
    from companion.desk.ground.look_ground import MountError, run

    with told(MountError):
        return _of_drives(lambda: run(options.picture, file=options.config, out=options.out))


def _costmap(options: argparse.Namespace) -> int:
    from companion.desk.costmap import command
    from companion.desk.ground.look_ground import MountError

    with told(MountError):
        return _of_drives(
            lambda: command.run(
                options.recording, file=options.config or None, out=options.out, at=options.at
            )
        )


def _begin(options: argparse.Namespace) -> None:
    """Say what begins: importing what a command needs takes a second, on a small computer several."""
    if options.drive is None:  # `tune --take` judges none
        return
    print(f"companion {options.command}: {options.drive}", file=sys.stderr, flush=True)


def _rehearse(options: argparse.Namespace) -> int:
    _begin(options)
    from companion.desk.drives import rehearsing

    return _of_drives(
        lambda: rehearsing.run(
            options.drive,
            file=options.config,
            out=options.out,
            answers=options.answers,
            memory=options.memory,
            ask=not options.no_ask,
            port=options.port if options.browser else None,
        )
    )


def _replay(options: argparse.Namespace) -> int:
    _begin(options)
    from companion.desk.drives import replaying

    return _of_drives(
        lambda: replaying.run(
            options.drive,
            file=options.config or None,
            default=default_config(),
            refs=options.refs,
            update=options.update_refs,
        )
    )


def _tune(options: argparse.Namespace) -> int:
    _begin(options)
    from companion.desk.tuning import take, tune_command

    if options.take is not None:
        source = options.source or f"{options.out}/tuning.json"
        file = options.write or options.config
        return _of_drives(
            lambda: take.take(options.take, source=source, file=file, write=options.write is not None)
        )
    if options.drive is None or options.source or options.write:
        raise UserError(
            "give a drive to judge, or --take N of an earlier run; --from and --write belong to it"
        )
    return _of_drives(
        lambda: tune_command.run(
            options.drive,
            file=options.config,
            wanted=options.calls_per_minute,
            out=options.out,
            answers=options.answers,
            keep_roi=options.keep_roi,
            jobs=options.jobs,
            cache=options.cache,
        )
    )


def _of_drives(act: Callable[[], int]) -> int:
    log_to_stderr(logging.ERROR)
    from anytraverse.errors import AnyTraverseError
    from companion.desk.drives.drive import DriveError
    from companion.desk.memory.command import MemoryCommandError
    from companion.desk.memory.scene_file import SceneFileError

    with told(AnyTraverseError, DriveError, MemoryCommandError, SceneFileError, OSError):
        return act()
