"""Reads rovers' /state.json: the words in force that no parameter holds, and those given before."""

from __future__ import annotations

from companion.wire.documents import read_state
from companion.wire.ids import State, words_hash
from companion.wire.json_values import DocumentError
from gcs_plugin.client.client import OperatorClient
from gcs_plugin.client.fetch import Fetch, FetchStatus
from gcs_plugin.client.rovers import TrackedRover

PATH = "/state.json"
FIRST_S, AGAIN_S, LONGEST_S = 5.0, 60.0, 480.0
"""Seconds between two readings: before the first that came, and after it, since a radio is shared.

Twice as long each time that the words in force were others again.
"""


class StateFiles:
    """Reads each rover's file once it has started, and again when its summary tells of other words.

    A file that an operator asked for goes first: `stop` before it is fetched.
    """

    def __init__(self, client: OperatorClient) -> None:
        self._client = client
        self._fetches: dict[int, Fetch] = {}
        self._pauses: dict[int, float] = {}
        self._asked_at: dict[int, float] = {}

    def stop(self, system: int) -> None:
        """Give up what is being read."""
        self._fetches.pop(system, None)

    def step(self, rover: TrackedRover, now: float) -> None:
        """Take what has come, or ask for it where it is due."""
        system = rover.system
        fetch = self._fetches.get(system)
        if fetch is not None and fetch.settled:
            del self._fetches[system]
            self._take(fetch, rover)
        elif fetch is None and not _known(rover) and rover.alive(now) and rover.state is not State.STARTING:
            pause = self._pauses.get(system, FIRST_S if rover.state_file is None else AGAIN_S)
            if now - self._asked_at.get(system, float("-inf")) >= pause:
                self._pauses[system], self._asked_at[system] = min(2 * pause, LONGEST_S), now
                self._fetches[system] = self._client.fetch(system, PATH, now, background=True)

    def _take(self, fetch: Fetch, rover: TrackedRover) -> None:
        try:
            state = read_state(fetch.content) if fetch.status is FetchStatus.DONE else None
        except DocumentError:
            return
        if state is not None and not state.starting:
            rover.state_file = state
            if _known(rover):
                self._pauses.pop(rover.system, None)


def _known(rover: TrackedRover) -> bool:
    state, summary = rover.state_file, rover.summary
    return state is not None and (summary is None or summary.words == words_hash(state.words))
