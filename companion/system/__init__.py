"""What any program on this computer needs: files written whole, the clock, errors that are survived."""
