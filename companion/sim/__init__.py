"""Simulates the field, rover and autopilot, and holds the demo and the loopback links of the tests."""
