"""Commands of a person at a desk: check, rehearse, replay, tune, and what a rover remembers."""
