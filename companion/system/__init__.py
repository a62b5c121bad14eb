"""Helps all other packages: writes files whole, guards against errors, measures the computer."""
