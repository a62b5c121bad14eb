"""Compares bundles in ONNX Runtime with the authors' step in PyTorch. Run: python -m bench.clipseg"""
