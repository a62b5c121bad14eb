"""When the operator is called and when the vehicle is held: a pure state machine.

Time comes in, decisions come out.
"""
