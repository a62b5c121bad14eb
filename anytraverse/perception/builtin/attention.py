"""Turns the network's outputs into probabilities of classes, and these into attention maps of words."""

from __future__ import annotations

from collections.abc import Sequence

import cv2
import numpy as np

from anytraverse.perception.builtin.calibration import Calibration, Floats
from anytraverse.perception.builtin.network import Outputs

UNKNOWN = "unknown"
"""The class of things without a name."""


def posteriors(outputs: Outputs, calibration: Calibration, far: Floats | None = None) -> Floats:
    """Calculate the probabilities of the classes, (C, h, w), of which that of `UNKNOWN` is the strangeness.

    The softmax of the calibrated logits divides what is not strange between the classes with a name.
    far: `distance` of these outputs where it is known already; None: it is calculated.
    """
    shares = softmax(outputs.logits + calibration.bias[:, None, None])
    index = calibration.classes.index(UNKNOWN)
    far = distance(outputs, calibration) if far is None else far
    strange = strangeness(shares[index], far, calibration)
    shares[index] = 0.0
    shares *= (1.0 - strange) / np.maximum(shares.sum(axis=0), 1e-9)
    shares[index] = strange
    return shares


def softmax(logits: Floats) -> Floats:
    """Calculate the softmax over the first axis, of the same shape."""
    powers = np.exp(logits - logits.max(axis=0))
    return np.asarray(powers / powers.sum(axis=0), dtype=np.float32)


def strangeness(thing: Floats, far: Floats, calibration: Calibration) -> Floats:
    """Calculate how surely each point shows something without a name, (h, w) in [0, 1].

    thing: (h, w), the network's own probability of that class. far: `distance`, (rows, columns), resized to
    (h, w). Each counts by its limit, which a stated share of known ground exceeds; half of each at its limit
    is a strangeness of 0.5.
    """
    size = thing.shape[1], thing.shape[0]
    near = np.asarray(cv2.resize(far, size, interpolation=cv2.INTER_LINEAR), dtype=np.float32)
    both = 0.5 * thing / calibration.limits[0] + 0.5 * near / calibration.limits[1]
    return np.asarray(1 / (1 + np.exp(np.clip(calibration.slope * (1 - both), -30, 30))), dtype=np.float32)


def distance(outputs: Outputs, calibration: Calibration) -> Floats:
    """Calculate the Mahalanobis distance to the nearest known class, (h/8, w/8), over the root of M.

    The classes share one covariance (Lee et al., A simple unified framework for detecting
    out-of-distribution samples, 2018).
    """
    cells = middle_cells(outputs)
    white = (cells.reshape(-1, cells.shape[-1]) - calibration.distance_mean) @ calibration.distance_whitening
    centres = calibration.distance_centres
    squares = (white**2).sum(axis=1, keepdims=True) - 2 * white @ centres.T + (centres**2).sum(axis=1)
    nearest = np.maximum(squares.min(axis=1), 0.0) / cells.shape[-1]
    return np.asarray(np.sqrt(nearest).reshape(cells.shape[:2]), dtype=np.float32)


def middle_cells(outputs: Outputs) -> Floats:
    """Join the features of strides 8 and 16, (h/8, w/8, M)."""
    fine = outputs.eighth.transpose(1, 2, 0)
    coarse = cv2.resize(
        np.ascontiguousarray(outputs.sixteenth.transpose(1, 2, 0)),
        (fine.shape[1], fine.shape[0]),
        interpolation=cv2.INTER_LINEAR,
    )
    return np.concatenate([fine, coarse], axis=-1, dtype=np.float32)


def attention(
    probabilities: Floats,
    own: Floats,
    sides: Sequence[bool | None],
    fits: Floats | None = None,
    reach: Floats | None = None,
) -> Floats:
    """Calculate the attention of N words, (N, h, w) in [0, 1], from the probabilities of classes (C, h, w).

    own (N, C): the weight of a class as evidence for a word; 0 where the word does not explain the class.
    sides: whether each word is drivable. The words of one side share what they explain: together it is the
    sum of the probabilities of their classes, which the word with the most evidence gets whole, and every
    other in proportion to its evidence. So trail beside grass, both drivable, is as certain as both together.
    fits (N, C, h, w) or None: how well a point's colours suit each word, a factor on its classes. reach
    (N, h, w) or None: the share of its classes that each word explains at each point; None: all.
    """
    if not len(own):
        return np.zeros((0, *probabilities.shape[1:]), dtype=np.float32)
    found = np.zeros((len(own), *probabilities.shape[1:]), dtype=np.float32)
    explains = (own > 0).astype(np.float32)[:, :, None, None]
    if fits is None:
        evidence = np.tensordot(own, probabilities, 1)
    else:
        evidence = np.einsum("nc,nchw,chw->nhw", own, fits, probabilities)
        explains = explains * fits
    if reach is not None:
        explains = explains * reach[:, None]
    for side in set(sides):
        members = [index for index, each in enumerate(sides) if each == side]
        explained = (explains[members].max(axis=0) * probabilities).sum(axis=0)
        best = np.maximum(evidence[members].max(axis=0), 1e-9)
        found[members] = explained * (evidence[members] / best)
    return np.clip(found, 0.0, 1.0, out=found)
