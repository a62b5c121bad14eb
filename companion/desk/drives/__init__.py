"""Judges a drive that was filmed again at a desk, in the drive's own time."""
