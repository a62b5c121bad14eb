"""Helpers for every room: atomic file writes, the wall clock, an error guard, and the shipped files."""
