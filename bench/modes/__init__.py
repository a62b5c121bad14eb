"""Sets modes by hand round the companion's own mode commands, and counts which human is overridden."""
