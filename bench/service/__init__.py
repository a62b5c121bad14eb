"""Tests the installed service in a booted Debian: a container with systemd as its process 1. Needs root."""
