"""Training of the built-in perceiver's network on labelled frames, for a workstation: it needs torch.

From folders of NNNN.jpg + NNNN.png + classes.json to one ONNX file and its calibration. Nothing here runs on
a rover, and nothing here knows where frames come from but the folders that it is given.
"""
