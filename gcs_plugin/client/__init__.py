"""Implements the operator's end of the protocol, without I/O: see `gcs_plugin.client.client`."""
