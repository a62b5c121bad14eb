"""Runs the supervisor's main loop and carries out what the state machine decides."""
