"""`python -m companion.field`: the former name of `companion.sim.field`."""

from companion.sim.field.__main__ import main

if __name__ == "__main__":
    raise SystemExit(main())
