"""Implements the operator's terminal, and what it shares with the MAVProxy module."""
