"""Looks at the ground at a desk: whether the configured mount is right, and what it must be."""
