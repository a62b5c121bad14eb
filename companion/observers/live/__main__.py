"""Starts the live view, for the supervisor: `python -m companion.observers.live HOST PORT CHANNEL PARENT`."""

from companion.system.child_process import begin

if __name__ == "__main__":
    # The live view goes with the page, before the recorder, when memory runs out.
    host, port, channel = begin(3, niceness=15, first_out=1000)

    from companion.observers.live.process import main

    main(int(channel), host, int(port))
