"""What is on the wire: ids, payload layouts, parameter names, texts and the message table.

No I/O; both ends import it.
"""
