"""Makes `companion costmap`: a recorded drive's grid of the ground, for a person and for Nav2."""
