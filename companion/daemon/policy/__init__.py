"""Decides whether the vehicle may be held: policy, off switch, stopping distance, shadow policy."""
