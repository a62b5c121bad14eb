"""Tests whether the rover stops: causes faults on purpose while it drives the simulated trail, by seed."""
