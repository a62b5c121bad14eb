"""Looks at the ground at a desk: whether the mount is right, and what it must be."""
