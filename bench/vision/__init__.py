"""Tests that the death of the vision process loses nothing that was acknowledged."""
