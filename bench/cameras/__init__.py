"""Live cameras under losses: real servers and pipes, whose pictures show when they were made."""
