"""Collects what a rover has shown, and writes it into one signed file for somebody else."""
