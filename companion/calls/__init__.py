"""Decides when the operator is called and when the vehicle is held: a pure state machine.

Time is an input, decisions are the output. Nothing here does I/O or reads a clock.
"""
