"""The recorder: a process that writes what the companion sees and does into a ring of MCAP files."""
