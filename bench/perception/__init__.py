"""Measures how far a perceiver may be trusted at home and abroad: `make bench-perception`."""
