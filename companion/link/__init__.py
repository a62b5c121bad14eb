"""MAVLink: the one owner of the connection; what is said, how often, and what is heard.

`from companion.link.link import Link`, `from companion.link.settings import LinkSettings`.
"""
