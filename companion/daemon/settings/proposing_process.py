"""Starts what proposes a changed file: `python -m` this module, CHANNEL and PARENT."""

from companion.system.child_process import begin

if __name__ == "__main__":
    (channel,) = begin(1, niceness=10, first_out=1000)

    from companion.daemon.settings.proposing import main

    main(int(channel))
