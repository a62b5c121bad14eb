"""Produces faults for real, and measures what the companion makes of them."""
