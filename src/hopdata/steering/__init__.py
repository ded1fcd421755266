"""Steering: from recorded hops to a model of the frame change, and a controller that uses it."""

import numpy as np

# How an excitation is drawn and observed: corrected, or by the dissertation's
# Algorithms 1 to 4 as printed.
OBSERVATIONS = CORRECTED, PRINTED = ("corrected", "printed")

# Random streams under the seed of an excitation: the first number of the key.

START = 0  # followed by the place of the experiment and the number of the start
FLOOR, EXCITATION, TRIAL, TRAINING = 1, 10, 11, 12


def child(seed: np.random.SeedSequence, *key: int) -> np.random.SeedSequence:
    """Return the stream of a seed that this key names; it is the same at every call."""
    return np.random.SeedSequence(seed.entropy, spawn_key=(*seed.spawn_key, *key))
