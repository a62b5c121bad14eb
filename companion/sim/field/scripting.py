"""Runs one Lua script as ArduPilot's scripting does, with its bindings and limits, in virtual time.

It needs lupa with Lua 5.3, the version in ArduPilot. Numbers have 64 bits here and 32 there.
"""

from __future__ import annotations

from collections import deque
from pathlib import Path
from typing import Any, Protocol

from companion.sim.field.rawframes import raw_frames

MAX_AUTHORISERS = 3
MAX_NAME = 16
MAX_LOCALS = 100
"""Local variables of a function at once in ArduPilot's Lua; Lua itself allows 200."""
_OTHERS = "local " + ", ".join(f"_{place}" for place in range(200 - MAX_LOCALS)) + " "
"""Takes those of the main function that ArduPilot's Lua does not have."""
_BINDINGS = Path(__file__).with_name("bindings.lua")
# As in ArduPilot: once the steps are used up, every further step raises the error again. So a script that
# catches it with pcall ends all the same.
_HOOK = b"""
local function stop() debug.sethook(stop, "", 1) error("exceeded time limit", 0) end
return stop
"""


class Host(Protocol):
    """What a script can see and do on the autopilot. Mode numbers, reasons and switches are ArduPilot's.

    `millis` never goes backwards; scripts see its lower 32 bits.
    """

    def millis(self) -> int: ...
    def mode(self) -> int: ...
    def mode_reason(self) -> int: ...
    def set_mode(self, number: int) -> bool: ...
    def is_armed(self) -> bool: ...
    def speed(self) -> float: ...
    def send_text(self, severity: int, text: bytes) -> None: ...
    def send_message(self, channel: int, number: int, payload: bytes) -> bool: ...
    def parameter(self, name: str) -> float | None: ...
    def add_parameter(self, name: str, default: float) -> None: ...
    def proximity_sensors(self) -> int: ...
    def proximity_status(self) -> int: ...
    def switch(self, function: int) -> int | None: ...


class Scripting:
    """Runs one script. Pass what comes in on any port to `hear`, and call `poll` often.

    `ended` says why the script does not run any more, "" while it runs. `blocked`: commands that the
    autopilot does not answer, not even when the script has ended. An error that it does not catch ends
    it; so do more than `vm_steps` instructions in one run, which it cannot prevent. As in ArduPilot up to
    4.6, `restart` does not free the slots of auxiliary authorisation (who may forbid arming).
    """

    def __init__(self, source: str, name: str, host: Host, *, vm_steps: int = 10_000) -> None:
        """Loads the script. Raises ImportError without lupa, ValueError when `source` is no Lua."""
        self._source, self._name, self._host, self._steps = source, name, host, vm_steps
        self._tables: dict[int, str] = {}
        self.boot()

    def boot(self) -> None:
        """Starts the script as the autopilot does when it boots."""
        self._authorisers: list[str | None] = []
        self._crowded = False
        self._depth = self._room = self._places = 0
        self._ids: set[int] = set()
        self.blocked: set[int] = set()
        self._queue: deque[tuple[bytes, int, int]] = deque()
        self.restart()

    def restart(self) -> None:
        """Restarts the script as MAV_CMD_SCRIPTING does: its state is lost, frames in its queue stay."""
        from lupa import lua53

        self.ended = ""
        self.blocked.clear()
        lua = lua53.LuaRuntime(encoding=None, register_eval=False, register_builtins=False)
        self._error: type[Exception] = lua53.LuaError
        self._set_hook = lua.eval(b"debug.sethook")
        self._hook = lua.execute(_HOOK)
        load = lua.eval(b"function(text, name, env) return load(text, name, 't', env) end")
        bindings = load(_BINDINGS.read_bytes(), b"=bindings.lua", lua.globals())
        sandbox = bindings(lua.table_from(self._offered()))
        chunk = load((_OTHERS + self._source).encode(), f"={self._name}".encode(), sandbox)
        if isinstance(chunk, tuple):
            raise ValueError(f"this is no Lua: {chunk[1].decode(errors='replace')}")
        self._next: Any = chunk
        self._due = self._host.millis()

    def open_queue(self, depth: int, places: int) -> None:
        """Opens the queue that all scripts share: `depth` frames, `places` message ids, each 1 to 25.

        Opened again, it keeps its depth, and all registrations are lost, as in ArduPilot 4.6. Raises
        RuntimeError where it then shall have more places than at first: 4.6 writes past their end.
        """
        if not self._depth:
            self._depth, self._room = depth, places
        if places > self._room:
            raise RuntimeError("memory is overwritten: more registrations than the first init had")
        self._places = places
        self._ids.clear()

    def register(self, number: int) -> bool:
        """Registers a message id, as any script may: False where it is already. Raises where none fits."""
        if number in self._ids:
            return False
        if len(self._ids) >= self._places:
            raise RuntimeError("no registrations free")
        self._ids.add(number)
        return True

    def forbids_arming(self) -> str:
        """Returns why the script forbids arming; "" when it does not."""
        if self._crowded:
            return "Too many auxiliary authorisers"
        return next((why for why in self._authorisers if why), "")

    def receive(self, datagram: bytes, channel: int) -> None:
        """Queues the frames that the script has registered for; they are lost while the queue is full."""
        for number, structure in raw_frames(datagram):
            if number in self._ids and len(self._queue) < self._depth:
                self._queue.append((structure, channel, self._host.millis()))

    def poll(self) -> None:
        """Runs the script if it is due."""
        if self.ended or self._host.millis() < self._due:
            return
        self._set_hook(self._hook, b"", self._steps)
        try:
            again = self._next()
        except self._error as problem:
            self._end(str(problem).splitlines()[0])
            return
        finally:
            self._set_hook()
        if not isinstance(again, tuple) or len(again) != 2:
            self._end(f"{self._name} did not return a function and a delay")
            return
        self._next, delay = again
        self._due = self._host.millis() + int(delay)

    def _end(self, why: str) -> None:
        self.ended = why
        self._host.send_text(2, f"Lua: {why}".encode())

    def _offered(self) -> dict[bytes, Any]:
        host = self._host
        plain = (
            "millis mode mode_reason set_mode is_armed speed send_text proximity_sensors proximity_status "
            "switch"
        )
        return {
            **{name.encode(): getattr(host, name) for name in plain.split()},
            b"parameter": lambda name: host.parameter(name.decode()),
            b"add_table": self._add_table,
            b"add_parameter": self._add_parameter,
            b"open_queue": self.open_queue,
            b"register": self.register,
            b"block": self._block,
            b"send": host.send_message,
            b"receive": self._receive,
            b"get_auth": self._get_auth,
            b"set_auth": self._set_auth,
        }

    def _receive(self) -> tuple[bytes, int, int] | None:
        if not self._depth:
            raise RuntimeError("RX not initialized")
        return self._queue.popleft() if self._queue else None

    def _block(self, command: int) -> bool:
        self.blocked.add(command)
        return True

    def _add_table(self, key: int, prefix: bytes, _size: int) -> bool:
        return self._tables.setdefault(key, prefix.decode()) == prefix.decode()

    def _add_parameter(self, key: int, _index: int, name: bytes, default: float) -> bool:
        full = self._tables.get(key, "") + name.decode()
        if key not in self._tables or len(full) > MAX_NAME:
            return False
        self._host.add_parameter(full, float(default))
        return True

    def _get_auth(self) -> int | None:
        if len(self._authorisers) >= MAX_AUTHORISERS:
            self._crowded = True
            return None
        self._authorisers.append("Waiting for auxiliary authorisation")
        return len(self._authorisers) - 1

    def _set_auth(self, place: int, why: bytes | None) -> None:
        if place < len(self._authorisers):
            self._authorisers[place] = None if why is None else why.decode(errors="replace")
