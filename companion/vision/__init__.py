"""Runs camera, perceiver and engine in a process of their own, which the supervisor watches and restarts.

`python -m companion.vision` is the process (`process.py`, `worker.py`); `client.py` is the supervisor's side.
Only the process imports OpenCV and ONNX Runtime.
"""
