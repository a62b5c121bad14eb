"""Finds the thresholds and the region of interest by which a drive raises the wanted calls."""
