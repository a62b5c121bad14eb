"""`python -m companion.wire` prints the table of messages as markdown, or of `parameters`."""

import sys

from companion.wire import messages, parameter_page

print((parameter_page if sys.argv[1:] == ["parameters"] else messages).markdown(), end="")
