"""The operator's console: a page in a browser that shows what rovers ask, and sends the answers."""
