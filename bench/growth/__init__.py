"""How the cost of judging, remembering and storing grows."""
