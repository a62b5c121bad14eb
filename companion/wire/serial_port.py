"""How either end opens a serial port, and what a person can do about one that does not open."""

from __future__ import annotations

import errno
from typing import Any

_IN_USE = "{} is in use by another program: `fuser {}` finds it"
_REMEDIES = {
    errno.ENOENT: "{} is not there: plug it in, or find its name in /dev/serial/by-id",
    errno.EACCES: "{} may not be opened by this user: `sudo usermod -aG dialout USER`, then log in again",
    errno.EAGAIN: _IN_USE,
    errno.EBUSY: _IN_USE,
}


def open_port(device: str, baud: int) -> Any:
    """A port of pyserial's that waits for nothing, held for ourselves alone. Raises OSError only.

    pyserial lets ValueError, termios.error and TypeError out.
    """
    import serial

    try:
        return serial.Serial(device, baud, timeout=0, write_timeout=0, exclusive=True)
    except OSError as error:
        why = _REMEDIES.get(error.errno or 0)
        if why is None:
            raise
        raise OSError(error.errno, why.format(device, device)) from error
    except Exception as error:
        raise OSError(errno.EIO, str(error)) from error
