"""Asks root's helper to change the configuration file, and hears what became of it."""

from __future__ import annotations

import os
import secrets
from collections.abc import Mapping
from contextlib import suppress
from pathlib import Path

import msgspec

from companion.config.request import (
    ANSWERS,
    LEAVE,
    LEAVE_LASTS,
    REQUEST,
    ConfigAnswer,
    ConfigRequest,
    RestartLeave,
    Value,
    clock,
    read_answer,
)
from companion.system.atomic_write import write_atomically
from companion.vehicle.state import Vehicle

WITHIN = 20.0
"""Seconds that the helper has to answer."""
WRITES_WITHIN = 15.0
"""Seconds in which it may begin to write: it answers before it is said that nothing was written."""
LEAVE_STANDS = 3.0
"""Seconds for which the leave to start again is renewed: the helper needs less."""
_RENEWED_EVERY = 0.2
HEARD_WITHIN = 3.0
"""Seconds for which it is known whether the vehicle is armed: it says so each second."""
_HOW_ELSE = "connect the autopilot, or edit the file"
_UNIT = "systemctl status anytraverse-config.path"


class FileChange:
    """Has one change of the file made at a time: the companion is then started again. Nothing here waits.

    Both files are in memory (/run).
    """

    def __init__(self, requests: Path, answers: Path = ANSWERS) -> None:
        """requests: the supervisor's runtime directory. answers: the helper's."""
        self._request = requests / REQUEST
        self._leave = requests / LEAVE
        self._answers = answers
        self._asked = self._leave_id = ""
        self._until = self._leave_until = self._renew_at = 0.0
        with suppress(OSError):  # of the companion before: nobody waits for it any more
            self._request.unlink(missing_ok=True)
            self._leave.unlink(missing_ok=True)

    @classmethod
    def of_service(cls) -> FileChange | None:
        """Return that of this service, None where systemd has not started it, and so no helper."""
        runtime = os.environ.get("RUNTIME_DIRECTORY", "").partition(":")[0]
        return cls(Path(runtime)) if runtime and ANSWERS.parent == Path(runtime).parent else None

    def ask(
        self,
        changes: Mapping[str, Value],
        sha256: str,
        asked_from: str,
        vehicle: Vehicle | None,
        now: float,
    ) -> str:
        """Ask for changes, as of `propose`; return why not, "" where the request was laid down.

        sha256: of the file for which they were made. asked_from: the address of who asked, for the log.
        vehicle: its newest state; a vehicle that is armed, or of which that is not known, stays as it is,
        since the companion starts again. now: s of the link's clock.
        """
        if self._asked:
            return "another change is being made: wait for it"
        if self._leave_until:
            return "the companion is starting again: wait for it"
        if why := _not_disarmed(vehicle, now):
            return f"{why}: {'disarm it first' if vehicle and vehicle.armed else _HOW_ELSE}"
        until = clock() + WRITES_WITHIN
        request = ConfigRequest(secrets.token_hex(8), sha256, asked_from, dict(changes), until)
        try:
            write_atomically(self._request, msgspec.json.encode(request), sync=False)
        except OSError as error:
            return f"the request cannot be laid down: {(error.strerror or str(error)).lower()}"
        self._asked, self._until = request.id, now + WITHIN
        return ""

    def answer(self, vehicle: Vehicle | None, now: float) -> ConfigAnswer | None:
        """Return what became of the request, once; None while there is none or it is not answered yet.

        Once the file is written, the helper gets leave to start the companion again, if the vehicle is still
        disarmed; that is then `restarts`.
        """
        if not self._asked:
            return None
        found = read_answer(self._answers)
        if found is None or found.id != self._asked:
            if now < self._until:
                return None
            self._request.unlink(missing_ok=True)  # it is not to be done when nobody waits any more
            found = ConfigAnswer(self._asked, written=False, text=f"no answer: see {_UNIT}")
        self._asked = ""
        if not found.written:
            return found
        why = _not_disarmed(vehicle, now) if found.restarts else "it took too long"
        if not why:
            self._leave_id, self._leave_until = found.id, now + LEAVE_STANDS
            why = self._give_leave(now)
        return msgspec.structs.replace(
            found, restarts=not why, text=f"{found.text}; {why}" if why else found.text
        )

    def watch(self, vehicle: Vehicle | None, now: float) -> None:
        """Renew the leave; take it back where the vehicle is armed by now, and where nobody took it."""
        if not self._leave_until:
            return
        if now >= self._leave_until or _not_disarmed(vehicle, now):
            self._leave.unlink(missing_ok=True)
            self._leave_until = 0.0
        elif now >= self._renew_at:
            self._give_leave(now)

    def _give_leave(self, now: float) -> str:
        """Let the helper start the companion again; say why not, or ""."""
        leave = RestartLeave(self._leave_id, clock() + LEAVE_LASTS)
        try:
            write_atomically(self._leave, msgspec.json.encode(leave), sync=False)
        except OSError as error:
            self._leave_until = 0.0
            return f"the leave to start again cannot be laid down: {(error.strerror or str(error)).lower()}"
        self._renew_at = now + _RENEWED_EVERY
        return ""


def _not_disarmed(vehicle: Vehicle | None, now: float) -> str:
    """Say why a restart could be one of an armed vehicle; "" where it is known to be disarmed."""
    if vehicle is None or not now - vehicle.heard_at <= HEARD_WITHIN:
        return "it is not known whether the vehicle is armed"
    return "the vehicle is armed" if vehicle.armed else ""
