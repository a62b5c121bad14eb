"""Starts what packs an incident: `python -m companion.observers.recording.packing_process CHANNEL PARENT`."""

from companion.system.child_process import begin

if __name__ == "__main__":
    (channel,) = begin(1, niceness=19, first_out=1000)

    from companion.observers.recording.packing import main

    main(int(channel))
