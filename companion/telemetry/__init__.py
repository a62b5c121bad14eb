"""Composes what is sent of frames, calls and holds: summaries, call data and texts."""
