"""`python -m companion.field`: the former name of `companion.sim.field`."""
