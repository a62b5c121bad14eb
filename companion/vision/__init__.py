"""The vision process: camera, perceiver and engine, apart from the supervisor that watches and restarts it.

`python -m companion.vision` is the process (`process.py`, `worker.py`); the supervisor's side is `client.py`.
Only the process imports OpenCV and ONNX Runtime.
"""
