"""Tries the operator's console in a browser against the simulated rover."""
