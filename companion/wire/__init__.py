"""What is on the wire: ids, payload layouts, parameter names, texts and the message table.

Both ends import it. No I/O, but for the key and the timestamps that signing keeps in files.
"""
