"""Stands for `companion.sim.field` under its former name: `python -m companion.field`."""
