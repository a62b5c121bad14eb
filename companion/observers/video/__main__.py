"""Starts the video where systemd does that: `python -m companion.observers.video`.

The supervisor says by which program: GStreamer's bindings come with the system's Python.
"""

import os

from companion.system.socket_units import arguments

if __name__ == "__main__":
    command = arguments()
    for descriptor in command[-2:-1]:
        os.set_inheritable(int(descriptor), True)  # noqa: FBT003
    os.execv(command[0], command)
