"""What the companion tells: summaries, the active alert, figures of its status."""
