"""Defines how many channels the network has where others read it."""

from __future__ import annotations

SCALES = {4: 24, 8: 40, 16: 112, 32: 320}
"""Stride -> channels of the features that the backbone returns."""
FEATURES = 32
"""Channels of the last layer before the class logits."""
MIDDLE = SCALES[8] + SCALES[16]
"""Channels of the features at strides 8 and 16, by which distances and scenes are judged."""
