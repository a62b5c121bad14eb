"""Trains the built-in perceiver's network on labelled frames. Runs on a workstation, since it needs torch.

Input: folders of NNNN.jpg, NNNN.png and classes.json. Output: one ONNX file and its calibration. Nothing here
runs on a rover.
"""
