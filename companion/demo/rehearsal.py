"""`companion demo --camera ...`: real frames, no rover; what the daemon would have done is printed."""

from __future__ import annotations
