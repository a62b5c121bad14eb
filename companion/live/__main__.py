"""Starts the live view: `python -m companion.live HOST PORT CHANNEL PARENT`. Only the supervisor runs it."""

from companion.system.child_process import begin

if __name__ == "__main__":
    # The live view goes with the page, before the recorder, when memory runs out.
    host, port, channel = begin(3, niceness=15, first_out=1000)

    from companion.live.process import main

    main(int(channel), host, int(port))
