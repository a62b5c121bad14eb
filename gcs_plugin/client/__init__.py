"""The operator's end of the protocol: decoded messages in, messages to send and events out. No I/O."""

from __future__ import annotations

from gcs_plugin.client.client import OperatorClient

__all__ = ["OperatorClient"]
