"""Does the rover stop? Faults made on purpose while it drives the simulated trail, by seed."""
