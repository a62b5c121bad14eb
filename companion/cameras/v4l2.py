"""Reads cameras of the kernel, such as USB cameras: `v4l2:/dev/v4l/by-id/...` or `v4l2:0`."""
