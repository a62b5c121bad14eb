"""Starts the page, for the supervisor: `python -m companion.observers.page CHANNEL LISTENER PARENT`."""

from companion.system.child_process import begin

if __name__ == "__main__":
    # The page goes before the vision process, which has 900, when memory runs out.
    channel, listener = map(int, begin(2, niceness=10, first_out=1000))

    from companion.observers.page.server import main

    main(channel, listener)
