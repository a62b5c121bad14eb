"""Adds the commands that write, check and change a configuration: `companion init`, `companion config`."""

from __future__ import annotations

import argparse
import json
import os
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Any

from companion.cli_config import add_config
from companion.cli_errors import UserError, error_text

if sys.version_info >= (3, 11):
    import tomllib
else:
    import tomli as tomllib

if TYPE_CHECKING:
    from companion.config import Config

_SHIPPED = (
    "companion.toml",
    "companion.schema.json",
    *(f"vehicles/{name}.toml" for name in ("rover", "quadruped", "small-rover", "atv")),
    "ardupilot/anytraverse.lua",
    "qgroundcontrol/anytraverse.json",
    *(f"cockpit/{name}.json" for name in ("go", "stay", "look-again", "other-place", "word", "view")),
    *(f"cockpit/{name}.json" for name in ("off", "report", "hold")),
    "foxglove/anytraverse.json",
)


class _Settings(argparse.Action):
    """Takes FILE and what follows it. argparse ends the list at `--yes`, which then takes the rest."""

    def __call__(
        self, parser: argparse.ArgumentParser, namespace: argparse.Namespace, values: Any, option: Any = None
    ) -> None:
        found = [*namespace.settings, *values]
        if found and namespace.file is None and not namespace.settings and _names_file(found[0]):
            namespace.file = found.pop(0)
            if namespace.config is not None:
                parser.error("give FILE or --config FILE, not both")
            namespace.config = namespace.file
        namespace.settings = found
        namespace.yes = namespace.yes or option is not None


def _names_file(text: str) -> bool:
    return os.path.isfile(text) or ("=" not in text and ("/" in text or text.endswith(".toml")))


def add_settings(commands: argparse._SubParsersAction[argparse.ArgumentParser]) -> None:
    """Add the commands to the parser of `companion`."""
    init = commands.add_parser("init", help="write a configuration to edit")
    init.add_argument("folder", nargs="?", default=".", metavar="FOLDER", help="where, by default here")
    init.add_argument("--simulated", action="store_true", help="one that runs with the simulated field")
    init.set_defaults(run=_init)

    config = commands.add_parser("config", help="check a configuration")
    actions = config.add_subparsers(dest="action", required=True, metavar="action")
    check = actions.add_parser("check", help="say what is wrong with it, or what is in force")
    add_config(check, alone=True)
    check.set_defaults(run=_check)
    change = actions.add_parser("set", help="change settings, and keep the file's comments")
    change.usage = "%(prog)s [FILE | --config FILE] KEY=VALUE ... [--yes]"
    told = "as camera.rate=5; KEY= removes it. FILE may stand before them"
    change.add_argument("settings", nargs="*", action=_Settings, default=[], metavar="KEY=VALUE", help=told)
    change.add_argument(
        "--yes", nargs="*", action=_Settings, dest="settings", metavar="KEY=VALUE", help="do not ask"
    )
    add_config(change)
    change.set_defaults(run=_set, file=None, yes=False)
    schema = actions.add_parser("schema", help="print its JSON schema, by which editors complete and check")
    schema.set_defaults(run=_schema)


def _init(options: argparse.Namespace) -> int:
    from companion.config import Config

    folder = Path(options.folder)
    file = folder / _SHIPPED[0]
    if options.simulated and file.exists():
        raise UserError(f"{file} is there already: name another folder")
    try:
        _copy_out(folder)
        if options.simulated:
            _simulate(file)
    except OSError as error:
        why = (error.strerror or str(error)).lower()
        raise UserError(f"{error.filename or folder}: {why}: name a folder that you may write") from error
    if options.simulated:
        from companion.sim.simulated import next_steps

        print(next_steps(file))
        return 0
    most = Config().recording.size
    print(f"It records pictures, positions and the log, {most} MB as shipped: [recording] size = 0 ends that")
    print(f"Edit them, then: companion config check {file}")
    return 0


def _copy_out(folder: Path) -> None:
    from anytraverse.resources import resource

    for name in _SHIPPED:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        try:
            with path.open("x", encoding="utf-8") as file:
                file.write(resource(f"config/{name}").read_text(encoding="utf-8"))
            print(f"{path}: written")
        except FileExistsError:
            print(f"{path}: is there already, left as it is")


def _simulate(file: Path) -> None:
    from companion.config import ConfigError
    from companion.config.editing import propose
    from companion.sim.simulated import simulated_settings
    from companion.system.atomic_write import write_atomically

    proposal = propose(file, simulated_settings())
    if proposal.problems:
        raise UserError(error_text(ConfigError(proposal.problems)))
    write_atomically(file, proposal.after.encode())


def _check(options: argparse.Namespace) -> int:
    from anytraverse.errors import AnyTraverseError, UnknownWordError
    from companion.cameras import split_source
    from companion.cameras.places import absent_now
    from companion.config import ConfigError, format_config, word_problem
    from companion.config.reading import read_layer
    from companion.config.whole_check import load_checked

    try:
        config = load_checked(read_layer(options.config))
        runs = _try_perceiver(config)
    except ConfigError as error:
        raise UserError(error_text(error)) from error
    except UnknownWordError as error:
        raise UserError(str(word_problem(options.config, error.word, str(error)))) from error
    except AnyTraverseError as error:
        raise UserError(f"{options.config}: {error}") from error
    absent = absent_now(*split_source(config.camera.source))
    if absent:
        print(f"companion config: note: [camera] source: {absent}", file=sys.stderr)
    print(f"# perceiver: {runs}\n{format_config(config)}", end="")
    return 0


def _set(options: argparse.Namespace) -> int:
    from companion.config import ConfigError
    from companion.config.editing import propose, write

    file = Path(options.config)
    if options.file not in (None, options.config):
        raise UserError("give FILE or --config FILE, not both")
    if not options.settings:
        raise UserError("say what to change: KEY=VALUE, as in camera.rate=5")
    try:
        proposal = propose(file, dict(_setting(one) for one in options.settings))
        if proposal.problems:
            raise ConfigError(proposal.problems)
        if not proposal.diff:
            print(f"{file}: says that already")
            return 0
        print(proposal.diff)
        if not options.yes and not _agreed():
            print(f"{file}: left as it is")
            return 1
        kept = write(file, proposal)
    except ConfigError as error:
        raise UserError(error_text(error)) from error
    print(f"{file}: written; {kept} is the version before. It counts from the companion's next start")
    return 0


def _setting(text: str) -> tuple[str, object]:
    """Read KEY=VALUE: a value of TOML, else a text. Without a value it is removed."""
    key, mark, value = text.partition("=")
    if not mark:
        raise UserError(f"{text}: write KEY=VALUE, as in camera.rate=5")
    try:
        parsed: object = tomllib.loads(f"value = {value}")["value"] if value else None
    except tomllib.TOMLDecodeError:
        parsed = value
    return key.strip(), parsed


def _agreed() -> bool:
    try:
        return input("write it? [y/N] ").strip().lower() in {"y", "yes"}
    except EOFError:
        print()
        return False


def _schema(_options: argparse.Namespace) -> int:
    from companion.config import json_schema

    print(json.dumps(json_schema(), indent=1))
    return 0


def _try_perceiver(config: Config) -> str:
    """Load the perceiver as the daemon does, and return which model would run, and why.

    No frame is judged. A bundle's files are compared with their checksums, which takes seconds. Raises
    AnyTraverseError.
    """
    from companion.vision.messages import Model
    from companion.vision.warm_up import load_engine

    if ":" in config.perceiver.name:
        print(f"companion config: loading {config.perceiver.name}", file=sys.stderr)
    engine, _ = load_engine(config, None)
    return str(Model.of(engine.perceiver))
