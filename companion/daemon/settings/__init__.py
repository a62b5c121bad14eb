"""Manages the settings in force: as configured, and as the ground has set them since."""
