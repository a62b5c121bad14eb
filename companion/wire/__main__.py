"""`python -m companion.wire` prints the table of messages as markdown, or one of the other `PAGES`."""

import sys

from companion.wire import layouts, messages, number_page, parameter_page, refusals

PAGES = {
    "messages": messages.markdown,
    "parameters": parameter_page.markdown,
    "layouts": layouts.markdown,
    "numbers": number_page.markdown,
    "refusals": refusals.markdown,
}
page = PAGES.get(sys.argv[1] if len(sys.argv) > 1 else "messages")
if page is None:
    sys.exit(f"there is no page {sys.argv[1]}: {', '.join(PAGES)}")
print(page(), end="")
