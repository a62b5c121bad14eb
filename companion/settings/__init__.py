"""Settings in force: as configured, and as the ground has set them since."""
