"""Drives random simulated trails under each policy: what is touched, how far it comes, and what it asks."""
