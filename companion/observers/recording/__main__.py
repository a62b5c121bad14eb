"""Starts the recorder, for the supervisor.

`python -m companion.observers.recording FOLDER BYTES CHANNEL PARENT`
"""

from companion.system.child_process import begin

if __name__ == "__main__":
    # The recorder goes after the page, which has 1000, and before the video and vision, when memory runs out.
    folder, most, channel = begin(3, niceness=15, first_out=980)

    from companion.observers.recording.process import main

    main(int(channel), folder, int(most))
