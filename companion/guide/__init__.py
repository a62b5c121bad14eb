"""Drives round what leaves room: plans arcs over the local grid, and decides when a vehicle follows them."""
