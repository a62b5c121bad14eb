"""Sets up a rover that stands armed in AUTO: the daemon as it ships, and around it all that it talks to.

The daemon, `python -m companion run`, and the vision process that it starts are processes of their own, with
the perceiver `builtin:lexicon`, unless told otherwise. Camera, autopilot and operator are played by this
process, over real sockets.
"""

from __future__ import annotations

import signal
import time
from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack, closing
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from anytraverse.operations import Operation
from bench.faults.row import BACK_WITHIN, HOLD_WITHIN, Row, RowOutcome, Work
from bench.faults.standing_wire import SYSTEM, Wire
from companion.cameras.field import CapturedFrame
from companion.desk.check.here import read_status
from companion.sim.demo.child import LoggedProcess
from companion.sim.field.frame_server import FrameServer
from companion.wire.answers import Acknowledgement, Answer
from companion.wire.call_report import CallReport
from companion.wire.delivery import Pending
from companion.wire.ids import Kind, Motion, State
from companion.wire.signing import SigningKey
from gcs_plugin.client import events as ev
from gcs_plugin.client.client import OperatorClient
from gcs_plugin.terminal.runner import Runner
from gcs_plugin.terminal.signing import OperatorSigning

STARTS_WITHIN = 60.0
_FRAME_PERIOD = 0.1
_LOOK = 0.005
_GRASS, _THING = (100, 120, 60), (200, 30, 200)
_TEXT = """\
[camera]
source = "{camera}"
latency = 0
[perceiver]
name = "{perceiver}"
threads = 1
[web]
{web}
[recording]
size = {recorded}
rate = 10
[vehicle]
file = ""
[link]
url = "{url}"
budget = 0
asked_budget = 0
pace = 0
{link}
[journal]
folder = "{state}"
[call]
policy = "{policy}"
[stopping]
unchecked = true
[words]
grass = 1.0
sky = -1.0
"""


def _write_key(path: Path) -> SigningKey:
    secret = bytes(range(1, 33))
    path.touch(0o600)
    path.write_bytes(secret)
    return SigningKey(secret)


class NotSeen(Exception):  # noqa: N818
    """Raised when something did not come in time, or the daemon ended. The message says what, and its log."""


class StandingPicture:
    """Draws what the camera sees: grass whose grain is new in every frame, with a thing ahead or without."""

    def __init__(self, seed: int) -> None:
        self._chance = np.random.default_rng(seed)

    def draw(self, *, thing: bool) -> NDArray[np.uint8]:
        """RGB, (96, 128, 3) uint8."""
        image = np.empty((96, 128, 3))
        image[:] = _GRASS
        if thing:
            image[45:95, 40:88] = _THING
        grain = self._chance.integers(-20, 21, image.shape[:2])[..., None]
        return np.clip(image + grain, 0, 255).astype(np.uint8)


class Standing:
    """The rover with its companion, which `start` starts. Time passes only in `run` and `wait`."""

    def __init__(
        self,
        out: Path,
        *,
        policy: str = "report",
        seed: int = 0,
        signs: bool = False,
        listens: bool = False,
        recorded: int = 0,
        perceiver: str = "builtin:lexicon",
        camera: str = "",
        web: str = 'listen = ""',
        link: str = "",
    ) -> None:
        """out: an existing folder. signs: all sign with one key. listens: as of `Wire`. recorded: MB.

        camera: its source; "": the rover's own pictures. web, link: lines of [web], and more of [link].
        """
        self.out, self.state = out, out / "state"
        self.thing = False
        """Whether an unknown thing is ahead."""
        self.clear_at = 0.0
        """Monotonic seconds when the newest picture without the thing was taken."""
        self.events: list[ev.Event] = []
        self.acknowledged: dict[int, Acknowledgement] = {}
        self._closing = ExitStack()
        self.key = _write_key(out / "signing.key") if signs else None
        self.wire = self._closing.enter_context(closing(Wire(self.key, listens=listens)))
        self._frames = self._closing.enter_context(closing(FrameServer()))
        self.client = OperatorClient()
        signing = None if self.key is None else OperatorSigning(self.key)
        self._runner = Runner(self.wire, self.client, signing=signing)
        self._picture = StandingPicture(seed)
        self._frame_id, self._frame_at = 0, 0.0
        self.config = out / "companion.toml"
        host, port = self._frames.address
        link = f'signing_key = "signing.key"\n{link}' if signs else link
        camera = camera or f"field:{host}:{port}"
        self._text = {"camera": camera, "url": self.wire.url, "link": link, "policy": policy}
        self._text |= {"recorded": str(recorded), "perceiver": perceiver, "web": web}
        self.config.touch(0o600)  # it may hold a token
        self.config.write_text(_TEXT.format(**self._text, state=self.state), encoding="utf-8")
        self.daemon: LoggedProcess | None = None

    def __enter__(self) -> Standing:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End all, whatever state it is in."""
        if self.daemon is not None:
            self.kill()
        self._closing.close()

    def start(self, environment: Mapping[str, str] | None = None, *, wait: bool = True) -> float:
        """Start a companion; an earlier one must have ended. Return s until it sees."""
        began = time.monotonic()
        (self.state / "status.json").unlink(missing_ok=True)
        self.wire.forget_rovers()
        self.daemon = self.another("daemon", self.config, environment)
        if wait:
            self.wait("a companion that sees", lambda: self._sees(began), STARTS_WITHIN)
        return time.monotonic() - began

    def config_with(self, state: Path) -> Path:
        """Write the same configuration with another state folder."""
        path = self.out / f"{state.name}.toml"
        path.write_text(_TEXT.format(**self._text, state=state), encoding="utf-8")
        return path

    def another(self, name: str, config: Path, environment: Mapping[str, str] | None = None) -> LoggedProcess:
        """Start a daemon besides; the caller ends it."""
        arguments = ["companion", "run", str(config)]
        log = self.out / f"{name}.log"
        return LoggedProcess(name, arguments, log, orphaned=signal.SIGKILL, environment=environment)

    def kill(self) -> None:
        """End the companion by SIGKILL."""
        if self.daemon is not None:
            self.daemon.process.kill()
            self.daemon.process.wait(10.0)

    def stop(self) -> int:
        """End the companion by SIGTERM, and return its exit code."""
        assert self.daemon is not None
        self.daemon.process.send_signal(signal.SIGTERM)
        self.wait("its end", lambda: self.daemon is None or not self.daemon.running, 15.0, runs=False)
        return int(self.daemon.process.returncode)

    @property
    def log(self) -> str:
        """What the companion logged since the first start."""
        path = self.out / "daemon.log"
        return path.read_text(encoding="utf-8", errors="replace") if path.exists() else ""

    def status(self) -> dict[str, Any]:
        """Read the status file; empty while there is none."""
        return read_status(self.state)[1]

    def judged(self) -> int:
        """How many frames this companion has judged, as it says in its status file once a second."""
        return int(self.status().get("frames", 0))

    def _sees(self, began: float) -> bool:
        """Whether a heartbeat since `began` says that it sees, or that an earlier call or hold is open."""
        rover, now = self.client.rovers.get(SYSTEM), time.monotonic()
        heard = rover is not None and rover.silence(now) < now - began
        return heard and self.heartbeat not in (None, State.STARTING, State.FAULT)

    def step(self) -> None:
        """Let some milliseconds pass."""
        now = time.monotonic()
        if now >= self._frame_at:
            self._frame_at = now + _FRAME_PERIOD
            self._frame_id += 1
            self.clear_at = self.clear_at if self.thing else now
            self._frames.publish(CapturedFrame(self._frame_id, now, self._picture.draw(thing=self.thing)))
        self.wire.step(now)
        self._runner.step(now)
        for event in self.client.events():
            self.events.append(event)
            if isinstance(event, ev.Acknowledged):
                self.acknowledged[event.acknowledgement.transaction] = event.acknowledgement
        time.sleep(_LOOK)

    def run(self, seconds: float) -> None:
        """Let so many seconds pass."""
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            self.step()

    def wait(self, what: str, fits: Callable[[], bool], limit: float, *, runs: bool = True) -> float:
        """Wait until `fits`, and return the seconds that it took. Raises NotSeen after `limit` s.

        runs: whether the companion must not end meanwhile.
        """
        began = time.monotonic()
        while not fits():
            self.step()
            if runs and self.daemon is not None and not self.daemon.running:
                raise NotSeen(f"{what}: the companion ended: {self.log[-2000:]}")
            if time.monotonic() - began > limit:
                raise NotSeen(f"{what}: not within {limit:.0f} s: {self.log[-2000:]}")
        return time.monotonic() - began

    @property
    def heartbeat(self) -> State | None:
        """The state in the companion's newest heartbeat."""
        rover = self.client.rovers.get(SYSTEM)
        return None if rover is None else rover.state

    def open_call(self, limit: float = 10.0, *, after: int = 0) -> CallReport:
        """Show the thing, and wait for the call that it makes, with an id above `after`."""
        self.thing = True
        found: list[CallReport] = []

        def opened() -> bool:
            rover = self.client.rovers.get(SYSTEM)
            calls = rover.open_calls() if rover is not None else []
            news = [call.data for call in calls if call.data.id > after]
            found[:] = [call for call in news if call.kind is Kind.CALL]
            return bool(found)

        self.wait("a call", opened, limit)
        return found[-1]

    def answer(
        self, target: int, motion: Motion, operations: Sequence[Operation] = (), limit: float = 20.0
    ) -> Acknowledgement:
        """Send an answer until it is acknowledged for good, and return the acknowledgement."""
        sent = self.client.answer(SYSTEM, Answer(target, motion, tuple(operations)), time.monotonic())
        self.wait(f"the acknowledgement of {sent.answer.transaction}", lambda: sent.settled, limit)
        return self.acknowledgement(sent)

    def acknowledgement(self, sent: Pending) -> Acknowledgement:
        """Return the acknowledgement of an answer. Raises NotSeen for one that got none."""
        found = self.acknowledged.get(sent.answer.transaction)
        if found is None:
            raise NotSeen(f"answer {sent.answer.transaction} was {sent.status.value}, not acknowledged")
        return found

    def summaries(self, since: int) -> int:
        """How many frames' summaries came among the events from number `since` on; one a second at most."""
        return sum(isinstance(event, ev.SummaryReceived) for event in self.events[since:])

    def texts(self, since: int = 0) -> list[str]:
        """Return the companion's STATUSTEXTs among the events from number `since` on."""
        return [event.text for event in self.events[since:] if isinstance(event, ev.TextReceived)]


def repeating(
    fault: str,
    produced: str,
    safe_state: str,
    times: int,
    once: Callable[[Work], RowOutcome],
    *,
    holds: bool = False,
    returns: bool = True,
) -> Row:
    """Make a row that produces its fault `times` times, each with a folder of its own; once if short."""

    def produce(work: Work) -> RowOutcome:
        numbers = range(len(work.seeds(times)))
        return _put_together([_once(work, number, once) for number in numbers])

    limits = HOLD_WITHIN if holds else None, BACK_WITHIN if returns else None
    return Row(fault, produced, safe_state, produce, *limits)


def _once(work: Work, number: int, once: Callable[[Work], RowOutcome]) -> RowOutcome:
    folder = work.folder / str(number)
    folder.mkdir()
    try:
        return once(Work(folder, work.seed + number, work.short))
    except Exception as error:  # whatever it is, the other rows are still to be produced
        return RowOutcome(1, (f"{type(error).__name__}: {error}",))


def _put_together(outcomes: Sequence[RowOutcome]) -> RowOutcome:
    return RowOutcome(
        sum(one.runs for one in outcomes),
        tuple(f"run {number}: {line}" for number, one in enumerate(outcomes) for line in one.wrong),
        max((one.hold_s for one in outcomes if one.hold_s is not None), default=None),
        max((one.return_s for one in outcomes if one.return_s is not None), default=None),
        outcomes[-1].saw,
    )
