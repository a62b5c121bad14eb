"""What the pages for a browser share: who may see them, what a connection may take, and their look."""
