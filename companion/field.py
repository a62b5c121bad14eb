"""Stands for `companion.sim.field` under its former name: `python -m companion.field`."""

from companion.sim.field.__main__ import main

if __name__ == "__main__":
    raise SystemExit(main())
