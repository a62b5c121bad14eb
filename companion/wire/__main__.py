"""`python -m companion.wire` prints the message table as markdown."""

from companion.wire.messages import markdown

print(markdown(), end="")
