"""Shows a browser what the companion does. A process of its own: it is told everything and asks nothing."""
