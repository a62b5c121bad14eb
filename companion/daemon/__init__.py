"""The supervisor's main loop and what it carries out."""
