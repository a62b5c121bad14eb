"""Compares the bundles of any word in ONNX Runtime with the authors' step in PyTorch. Run: python -m bench.clipseg"""
