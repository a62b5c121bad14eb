"""Eyes made of a segmentation network that the user trained: its class names are the words."""
