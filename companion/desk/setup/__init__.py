"""Sets up a rover in a browser (`companion setup`)."""
