"""The operator's console: a page in a browser that shows what rovers ask for, and sends the answers."""

from __future__ import annotations

import argparse
import asyncio
import contextlib
import logging
import signal
import socket
import sys
import threading
import time
import webbrowser
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

from anytraverse.release import own_version, to_install
from companion.pages.listen import Listen, check_token, hashed, read_listen
from companion.wire.signing_store import SigningKeyError, read_key
from gcs_plugin.client.client import OperatorClient
from gcs_plugin.console.console import Console
from gcs_plugin.console.links import Links
from gcs_plugin.console.rover_page import read_pages
from gcs_plugin.console.track import Background, read_background
from gcs_plugin.terminal.connection import EXAMPLES, LinkError, open_connection
from gcs_plugin.terminal.main import NOBODY, SILENT_S, UNSIGNED, identity, open_log
from gcs_plugin.terminal.output import JsonOutput
from gcs_plugin.terminal.signing import open_signing, state_folder

DEFAULT_LINK = "udpin:0.0.0.0:14550"
EXTRA = f"the console needs starlette and uvicorn: {to_install('ground')}"
MOST_LINKS = 8


class OptionError(ValueError):
    """Reports options that cannot be; the text says what to do."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run until a signal. Returns the exit code."""
    options = parser().parse_args(argv)
    try:
        listen, token = _listen(options)
        chosen = options.connect or [DEFAULT_LINK]
        if len(chosen) > MOST_LINKS:
            raise OptionError(f"at most {MOST_LINKS} --connect")
        pages = read_pages(options.page or [], _token(options.page_token_file))
        background = None if options.background is None else _background(options.background)
        key = None if options.signing_key is None else read_key(options.signing_key)
        alert = None if options.alert_url_file is None else _alert(options.alert_url_file)
        taken, connections = listen.bind(), [open_connection(link) for link in chosen]
    except (LinkError, SigningKeyError, ValueError) as error:
        print(f"anytraverse-console: {error}", file=sys.stderr)
        return 2
    except OSError as error:
        where = f"{options.host}:{options.port}"
        print(f"anytraverse-console: cannot listen on {where}: {error.strerror}", file=sys.stderr)
        return 2
    try:
        import starlette  # noqa: F401
        import uvicorn  # noqa: F401
    except ImportError:
        print(f"anytraverse-console: {EXTRA}", file=sys.stderr)
        return 2
    try:
        log = None if options.log is None else open_log(options.log)
    except OSError as error:
        print(f"anytraverse-console: {error}", file=sys.stderr)
        return 2
    signing = None if key is None else open_signing(key, options.system, options.component)
    client = OperatorClient()
    links = Links(connections, client, options.system, options.component, signing)
    logging.basicConfig(level=logging.WARNING, format="%(levelname)s %(name)s: %(message)s")
    for name in ("uvicorn", "uvicorn.error"):
        logging.getLogger(name).setLevel(logging.CRITICAL)

    def ready() -> None:
        taken.listen(64)  # before the address is told: who comes early waits
        url = Listen(listen.host, taken.getsockname()[1]).url()
        elsewhere = f" {options.origin}/ and, on this computer," if options.origin else ""
        print(f"The console is at{elsewhere} {url}", flush=True)
        print(f"It listens on {', '.join(one.name for one in connections)}. Ctrl-C ends it.", flush=True)
        if not options.no_browser:
            address = url + (f"?token={token}" if token else "")
            threading.Thread(target=webbrowser.open, args=(address,), daemon=True).start()

    told = None if log is None else JsonOutput(log, time.monotonic())
    console = Console(client, told, options.incidents, pages, alert)
    try:
        asyncio.run(_run(taken, listen, token, options.origin, links, console, background, ready))
    finally:
        links.close()
        if log is not None:
            log.close()
    return 0


async def _run(
    taken: socket.socket,
    listen: Listen,
    token: str,
    origin: str,
    links: Links,
    console: Console,
    background: Background | None,
    ready: Callable[[], None],
) -> None:
    """Serve the page until a signal. ready: tells where it is, once a signal ends it in order."""
    from companion.pages.access import Gate
    from companion.pages.requests import MOST_POSTED
    from companion.pages.site import Server
    from gcs_plugin.console.server import CYCLE, ConsoleSite

    problems = _Problems(links, console)

    def about() -> dict[str, Any]:
        names = [one.name for one in links.connections]
        return {"links": names, "problems": problems.now(), "doubled": links.doubled}

    site = ConsoleSite(console, about, background)
    gate = Gate(
        site.app(),
        token_hash=hashed(token),
        own_address=listen.host if listen.loopback else "",
        origin=origin,
        most_posted=MOST_POSTED,
        where_the_token_is="the file given by --token-file",
    )
    server = Server(gate)

    async def follow() -> None:
        while not server.should_exit:
            now = time.monotonic()
            links.step(now)
            console.step(now, time.time())
            await asyncio.sleep(CYCLE)

    def stop() -> None:
        server.should_exit = True

    for number in (signal.SIGINT, signal.SIGTERM):
        asyncio.get_running_loop().add_signal_handler(number, stop)
    ready()
    following = asyncio.create_task(follow())
    following.add_done_callback(lambda _: stop())
    await server.serve(sockets=[taken])
    with contextlib.suppress(asyncio.CancelledError):
        await following  # raises what ended it


class _Problems:
    """What is wrong with the links, and that nobody is heard."""

    def __init__(self, links: Links, console: Console) -> None:
        self._links = links
        self._console = console
        self._began = time.monotonic()
        self._signing: list[str] = []

    def now(self) -> list[str]:
        rovers = self._console.client.rovers
        down = [f"{one.name}: {one.trouble}; trying again" for one in self._links.connections if one.trouble]
        if self._links.signing is not None:
            self._signing = [*self._signing, *self._links.signing.problems()][-8:]
        else:
            down += [UNSIGNED.format(system) for system, rover in rovers.items() if rover.signs]
        if not rovers and time.monotonic() - self._began >= SILENT_S:
            down.append(NOBODY)
        return down + self._signing


def _listen(options: argparse.Namespace) -> tuple[Listen, str]:
    """Return where to listen, and the token, "" for none. Raises OptionError."""
    try:
        listen = read_listen(f"{options.host}:{options.port}")
        token = _token(options.token_file)
        check_token(token)
    except (ValueError, OSError) as error:
        raise OptionError(str(error)) from error
    assert listen is not None
    if options.token_file is not None and not token:
        raise OptionError(f"{options.token_file} holds no token: `openssl rand -hex 16` makes one")
    if options.origin and not options.origin.startswith(("http://", "https://")):
        raise OptionError("--origin is what browsers show, e.g. http://ground.local:8192")
    if not listen.loopback and not (token and options.origin):
        raise OptionError(
            "other computers reach this address: give --token-file and --origin, too, "
            "or leave --host away and use ssh -L"
        )
    return listen, token


def _token(file: Path | None) -> str:
    """Return the token in a file, "" for none. Raises OptionError."""
    try:
        return "" if file is None else file.read_text().strip()
    except (OSError, ValueError) as error:
        raise OptionError(str(error)) from error


def _alert(file: Path) -> Callable[[str, str], None]:
    """Return what posts an alert to the URL in a file. Raises OptionError."""
    from companion.system.alert import Alert, AlertSender

    try:
        sender = AlertSender(_token(file), f"the address in {file}")
    except ValueError as error:
        raise OptionError(f"{file}: {error}") from error
    if not sender.on:
        raise OptionError(f"{file} holds no address: write one as https://ntfy.sh/TOPIC")
    return lambda title, text: sender.send(Alert(title, text))


def _background(text: str) -> Background:
    try:
        return read_background(text)
    except ValueError as error:
        raise OptionError(str(error)) from error


def parser() -> argparse.ArgumentParser:
    """Return the parser of the command."""
    root = argparse.ArgumentParser(prog="anytraverse-console", description=__doc__)
    root.add_argument("--version", action="version", version=f"%(prog)s {own_version()}")
    root.add_argument(
        "--connect",
        action="append",
        metavar="LINK",
        help=f"{EXAMPLES} (default {DEFAULT_LINK}); several, the best one first",
    )
    root.add_argument("--port", type=int, default=0, help="of the page; by default any free one")
    root.add_argument("--host", default="127.0.0.1", help="where the page listens (default %(default)s)")
    root.add_argument("--origin", default="", metavar="URL", help="how browsers elsewhere open it")
    root.add_argument("--token-file", type=Path, metavar="FILE", help="what a browser must know to see it")
    root.add_argument(
        "--background",
        metavar="FILE@NORTH,WEST,SOUTH,EAST",
        help="PNG or JPEG to draw tracks on, with its upper left and lower right corner in degrees",
    )
    root.add_argument("--no-browser", action="store_true", help="do not open a browser")
    root.add_argument("--log", type=Path, metavar="FILE.jsonl", help="write events to a file, for programs")
    root.add_argument(
        "--incidents",
        type=Path,
        default=state_folder() / "incidents",
        metavar="FOLDER",
        help="where incident files are stored that are fetched (default %(default)s)",
    )
    root.add_argument(
        "--page",
        action="append",
        metavar="SYSTEM=URL",
        help="a rover's own page, from which incident files come by HTTP: 1=http://rover:8191",
    )
    root.add_argument("--page-token-file", type=Path, metavar="FILE", help="the token of these pages")
    root.add_argument(
        "--alert-url-file",
        type=Path,
        metavar="FILE",
        help="holds an address that is told of each call, ntfy's for one",
    )
    root.add_argument("--system", type=identity, default=255, help="our system id (default 255)")
    root.add_argument("--component", type=identity, default=190, help="our component id (default 190)")
    root.add_argument(
        "--signing-key", type=Path, metavar="FILE", help="sign with this key, and believe nothing unsigned"
    )
    return root


if __name__ == "__main__":
    sys.exit(main())
