"""The terminal operator, and what it shares with the MAVProxy module."""
