"""Owns the MAVLink connections: sends what is due within byte budgets, and routes what is received.

`from companion.link.link import Link`, `from companion.config.link_settings import LinkSettings`.
"""
