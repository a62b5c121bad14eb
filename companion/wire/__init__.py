"""Defines what is on the wire: ids, payload layouts, parameter names, texts and the message table.

The companion and the ground side import it. It does no I/O, except for the files of signing and `devices`.
"""
