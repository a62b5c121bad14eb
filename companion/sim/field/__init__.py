"""Simulates a field for the demo and the tests: a trail with things on it, a rover with mass that follows it,
its camera, and an autopilot that speaks MAVLink. Run it with `python -m companion.sim.field`."""
