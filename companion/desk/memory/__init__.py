"""Implements `companion memory`: lists, shows, forgets, exports and imports the answered scenes."""
