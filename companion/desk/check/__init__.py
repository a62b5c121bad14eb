"""Checks computer, vehicle and configuration before a drive: `companion check` and `companion status`."""
