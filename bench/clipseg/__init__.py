"""CLIPSeg through ONNX Runtime against the authors' step in PyTorch. Run: python -m bench.clipseg"""
