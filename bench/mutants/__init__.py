"""Puts small faults into the safety path, one at a time, and tests whether the tests notice each."""
