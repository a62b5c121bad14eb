"""Helpers for every room: atomic file writes, an error guard, and the shipped files."""
