"""Runs the daemon on the rover, its demo, and the checks of the rover and its configuration."""

from __future__ import annotations

import argparse
import logging
import os
import sys
import threading
from collections.abc import Sequence
from pathlib import Path

from anytraverse.release import needed, own_version
from companion.cli_config import SERVICE, add_config, default_config
from companion.cli_drives import add_drives
from companion.cli_errors import UserError, error_text, told
from companion.cli_memory import add_memory
from companion.cli_recordings import add_recordings
from companion.cli_settings import add_settings
from companion.cli_setup import add_setup
from companion.system.log_lines import dump_when_aborted, end_process, log_to_stderr, say_last

log = logging.getLogger(__name__)


def main(arguments: Sequence[str] | None = None, vision: Sequence[str] | None = None) -> int:
    """Run a command and return its exit code; 2, with what to mend or install on stderr, where it cannot be.

    vision: as for `companion.run.main`.
    """
    options = parser().parse_args(arguments)
    options.vision = vision
    verifies = getattr(options, "verify", None) is not None  # somebody's file, by no configuration
    if getattr(options, "config", "") is None and not verifies:
        options.config = default_config()
        if os.path.exists(options.config):
            print(f"companion {options.command}: by {options.config}", file=sys.stderr)
    try:
        code: int = options.run(options)
    except UserError as error:
        say_last(f"companion {options.command}: {error}", 2)
        return 2
    except ModuleNotFoundError as error:
        say_last(f"companion {options.command}: {needed(error, 'rover')}", 2)
        return 2
    except KeyboardInterrupt:
        return 130
    return code


class _Version(argparse.Action):
    """Looks the version up only where it is asked for, since that takes long."""

    def __call__(self, parser: argparse.ArgumentParser, *_: object) -> None:
        print(f"{parser.prog} {own_version()}")
        parser.exit()


def parser() -> argparse.ArgumentParser:
    """Return the parser of all commands."""
    root = argparse.ArgumentParser(
        prog="companion",
        description=__doc__,
        epilog="Each command of `companion` about a configuration takes --config FILE; by default it is "
        f"./companion.toml, or {SERVICE} where there is none here. A command about nothing else takes it "
        "as FILE, too.",
    )
    root.add_argument("--version", action=_Version, nargs=0, help="show the program's version and exit")
    commands = root.add_subparsers(dest="command", required=True, metavar="command")

    run = commands.add_parser("run", help="look, judge and call, until stopped")
    add_config(run, alone=True)
    run.add_argument("-v", "--verbose", action="store_true", help="log more")
    run.set_defaults(run=_run)

    demo = commands.add_parser("demo", help="drive a simulated trail and ask you about it")
    who = demo.add_mutually_exclusive_group()
    who.add_argument("--auto", action="store_true", help="answer by itself")
    who.add_argument("--console", action="store_true", help="answer in a browser")
    demo.add_argument("--seed", type=int, default=0, metavar="N", help="which trail, by default %(default)s")
    demo.add_argument("--out", metavar="FOLDER", help="where pictures and logs go, by default a new one")
    demo.add_argument("--camera", metavar="SOURCE", help="a camera of your own, e.g. video:drive.mp4")
    demo.add_argument(
        "--guide", action="store_true", help="let it drive round what leaves room on a wide path"
    )
    demo.add_argument("--animation", metavar="FILE", help="also write 10 s of it, as a WebP; with --auto")
    demo.set_defaults(run=_demo)

    whole = commands.add_parser("check", help="check the rover: stopping, autopilot, perceiver, journal")
    add_config(whole, alone=True)
    whole.add_argument("--link", metavar="URL", help="a way of the check's own to the autopilot")
    whole.add_argument("--json", action="store_true", help="the last line is one JSON object")
    instead = whole.add_mutually_exclusive_group()
    instead.add_argument("--dry-run", action="store_true", help="raise a test call, and wait for its answer")
    instead.add_argument("--measure", action="store_true", help="you drive and set HOLD; it fits the brakes")
    instead.add_argument("--zone", action="store_true", help="you carry a thing; it says where it is noticed")
    whole.set_defaults(run=_check_rover)

    cameras = commands.add_parser("cameras", help="list the cameras that are there, with a picture of each")
    add_config(cameras, alone=True)
    cameras.add_argument("--out", default=".", metavar="FOLDER", help="for the pictures, by default here")
    cameras.set_defaults(run=_cameras)

    status = commands.add_parser("status", help="say what the companion that runs says of itself")
    add_config(status, alone=True)
    status.add_argument("--json", action="store_true", help="the last line is one JSON object")
    status.set_defaults(run=_status)

    add_memory(commands)
    add_drives(commands)
    add_recordings(commands)
    add_settings(commands)
    add_setup(commands, lambda folder: main(["init", folder]))

    return root


def _run(options: argparse.Namespace) -> int:
    from anytraverse.errors import AnyTraverseError
    from companion.config import ConfigError, load_config
    from companion.config.link_settings import LinkSettingError
    from companion.storage import JournalError
    from companion.system.child_process import shut_out
    from companion.system.service_manager import ServiceManager, stop_on_signals
    from companion.wire.parameters import ParameterError

    log_to_stderr(logging.DEBUG if options.verbose else logging.INFO)
    dump_when_aborted()  # systemd's watchdog sends SIGABRT: the log shows what hung
    shut_out()
    stop, service = stop_on_signals(), ServiceManager()
    service.pause(stop)
    if stop():
        service.stopping()
        return 0
    with told():
        config = load_config(options.config)
    from companion.run import main as run  # a package that is missing is not of its running

    try:
        return _leave(run(config, stop, options.vision, service, Path(options.config)))
    except ConfigError as error:
        raise UserError(error_text(error)) from error
    except (AnyTraverseError, JournalError, LinkSettingError, ParameterError) as error:
        raise UserError(str(error)) from error
    except Exception:
        log.critical("the companion failed", exc_info=True)
        return _leave(1)


def _leave(code: int) -> int:
    """Return the exit code, or end the process at once where a thread still runs.

    The interpreter's own exit would abort one that runs native code.
    """
    if threading.active_count() > 1:
        sys.stdout.flush()
        end_process(code)
    return code


def _demo(options: argparse.Namespace) -> int:
    from companion.sim.demo.opening import begin
    from companion.system.side_process import missing_packages

    if missing := missing_packages({"cv2": "opencv-python-headless", "onnxruntime": "onnxruntime"}, "sim"):
        raise UserError(missing)
    if options.console and options.camera:
        raise UserError("--console is for the simulated trail: leave --camera or --console away")
    if options.animation and (options.camera or not options.auto):
        raise UserError("--animation is made of the simulated trail: give it with --auto, without --camera")
    if options.animation and not Path(options.animation).absolute().parent.is_dir():
        raise UserError(f"--animation {options.animation}: there is no such folder: make it first")
    story = begin(options)  # before what takes a busy computer seconds to import
    with story.signs_of_life():
        from companion.sim.demo.main import main as demo

        return demo(options, story)


def _check_rover(options: argparse.Namespace) -> int:
    log_to_stderr(logging.ERROR)
    if options.dry_run:
        from companion.desk.check.running import dry_run

        return dry_run(options.config, as_json=options.json)
    if options.measure:
        from companion.desk.check.measure import measure

        return measure(options.config, link=options.link)
    if options.zone:
        from companion.desk.check.zone import measure_zone

        return _leave(measure_zone(options.config))
    from companion.desk.check.table import check

    return check(options.config, link=options.link, as_json=options.json)


def _cameras(options: argparse.Namespace) -> int:
    from companion.desk.check.cameras import list_cameras

    return list_cameras(options.config, options.out)


def _status(options: argparse.Namespace) -> int:
    from companion.desk.check.running import print_status

    return print_status(options.config, as_json=options.json)


if __name__ == "__main__":
    sys.exit(main())
