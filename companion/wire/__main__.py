"""Prints the tables of docs/protocol.md as markdown: `python -m companion.wire [PAGE]`, see `PAGES`."""

import sys

from companion.wire import layouts, messages, refusals
from companion.wire.doc_generator import numbers_markdown, parameters_markdown

PAGES = {
    "messages": messages.markdown,
    "parameters": parameters_markdown,
    "layouts": layouts.markdown,
    "numbers": numbers_markdown,
    "refusals": refusals.markdown,
}
page = PAGES.get(sys.argv[1] if len(sys.argv) > 1 else "messages")
if page is None:
    sys.exit(f"there is no page {sys.argv[1]}: {', '.join(PAGES)}")
print(page(), end="")
