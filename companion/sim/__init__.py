"""Simulated field, rover and autopilot, the demo, and links without a device."""
