"""Changes the configuration file as root, for the supervisor, which may not.

systemd runs `python -I -m companion.config.root_helper FILE` when the supervisor has laid down a request.
Nothing that the supervisor says is believed: the request's form, the changes and the file are all checked
again here. It never changes what `guard_of` keeps for loopback, wherever the request came from: the
supervisor's word that it came over loopback would be worth what a broken-in supervisor is worth. Such
settings are changed in the shell, by root or the file's owner.

It starts the companion again only by the supervisor's leave, which is good for seconds: the vehicle may be
armed since the request, and a companion that starts sees nothing.
"""

from __future__ import annotations

import hashlib
import pwd
import subprocess
import sys
import time
from collections.abc import Callable
from pathlib import Path

import msgspec

from companion.config.editing import Guard, guard_of, propose, write
from companion.config.request import (
    ANSWER,
    ANSWERS,
    LONGEST,
    ConfigAnswer,
    ConfigRequest,
    ConfigRequestError,
    clock,
    has_leave,
    read_request,
)
from companion.config.toml_file import ConfigError
from companion.system.atomic_write import write_durably
from companion.wire.packing import clean

REQUESTS = Path("/run/anytraverse")
"""The runtime directory of the supervisor."""
_USER = "anytraverse"
_GRACE = 1.0
"""Seconds from the leave to the restart, in which who asked hears of it.

Longer than a leave lasts: that of a supervisor that hangs, and so cannot take it back, does not count."""
_LEAVE_WITHIN = 2.0
"""Seconds in which the supervisor gives its leave."""
_TICK = 0.05
_WITHIN = 10.0
_LONGEST = 2000


def main(file: str) -> int:
    """Answer the request that lies there, and restart the companion where the file was changed and it may be.

    Returns the exit code: 1 only where no answer could be left.
    """
    user = pwd.getpwnam(_USER).pw_uid
    answer = answered(Path(file), REQUESTS, user)
    print(f"{answer.id}: {'written' if answer.written else 'not written'}: {answer.text}", flush=True)
    try:
        leave(answer, ANSWERS)
    except OSError as error:
        print(f"no answer can be left: {error}", file=sys.stderr)
        return 1
    if answer.restarts and may_restart(answer.id, REQUESTS, user):
        restart = ["systemctl", "--no-block", "try-restart", "companion.service"]
        subprocess.run(restart, check=False, timeout=_WITHIN)
    elif answer.written:
        print(f"{answer.id}: not started again: it takes effect at the next start", flush=True)
    return 0


def may_restart(
    request_id: str, requests: Path, user: int, sleep: Callable[[float], None] = time.sleep
) -> bool:
    """Wait for the supervisor's leave, and return whether it still stands once who asked has heard of it."""
    until = clock() + _LEAVE_WITHIN
    while not has_leave(requests, user, request_id, clock()):
        if clock() >= until:
            return False
        sleep(_TICK)
    sleep(_GRACE)
    return has_leave(requests, user, request_id, clock())


def answered(file: Path, requests: Path, user: int) -> ConfigAnswer:
    """Do what the request in `requests` asks for, or not, and say so. user: whose the request must be."""
    try:
        request = read_request(requests, user)
    except (ConfigRequestError, OSError) as error:
        return _refused("", str(error))
    if late := _late(request):
        return _refused(request.id, late)
    keys = ", ".join(map(clean, request.changes))
    print(f"{request.id}: asked from {clean(request.asked_from[:64])}: {keys}")
    try:
        # Before anything else: the checks read the files that a configuration names, as root here.
        guarded = [key for key, value in request.changes.items() if _is_guarded(key, value)]
        proposal = propose(file, {} if guarded else request.changes)
        if hashlib.sha256(proposal.before.encode()).hexdigest() != request.sha256:
            return _refused(request.id, "the file was changed meanwhile: look at it, and try again")
        if guarded := [*guarded, *proposal.guarded]:
            return _refused(request.id, f"only in the shell, by `companion config set`: {', '.join(guarded)}")
        if late := _late(request):
            return _refused(request.id, late)
        kept = write(file, proposal)
    except (ConfigError, ValueError) as error:
        return _refused(request.id, str(error))
    in_time = not _late(request)  # a slow disk: who asked may have given up
    return ConfigAnswer(request.id, written=True, text=f"the version before is {kept}", restarts=in_time)


def _is_guarded(key: str, value: object) -> bool:
    try:
        return guard_of(key, value) is Guard.LOOPBACK
    except ValueError as error:
        raise ValueError(f"{key}: {error}") from error


def _late(request: ConfigRequest) -> str:
    """Say why a request is too late; "" where it is not. The vehicle may be armed by now."""
    if 0.0 < request.until - clock() <= LONGEST:
        return ""
    return "it took too long: is the computer busy, or the disk slow? Try again"


def _refused(request_id: str, why: str) -> ConfigAnswer:
    return ConfigAnswer(request_id, written=False, text=clean(why.replace("\n", "; "))[:_LONGEST])


def leave(answer: ConfigAnswer, folder: Path) -> None:
    """Write the answer for the supervisor to read. Raises OSError."""
    write_durably(folder / ANSWER, msgspec.json.encode(answer))


if __name__ == "__main__":
    sys.exit(main(sys.argv[1]))
