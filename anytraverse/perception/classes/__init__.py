"""Perceives with a segmentation network that the user trained: its class names are the words."""
