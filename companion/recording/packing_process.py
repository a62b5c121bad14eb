"""Starts what packs an incident: `python -m companion.recording.packing_process CHANNEL PARENT`."""

from companion.system.child_process import begin

if __name__ == "__main__":
    (channel,) = begin(1, niceness=19, first_out=1000)

    from companion.recording.packing import main

    main(int(channel))
