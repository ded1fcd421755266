"""Steering: from recorded hops to a model of the frame change, and its controllers."""

import numpy as np

# How an excitation is drawn and observed: corrected, or by the dissertation's
# Algorithms 1 to 4 as printed.
CORRECTED = "corrected"
PRINTED = "printed"
OBSERVATIONS = (CORRECTED, PRINTED)

# Random streams under the seed of an excitation: the first number of the key.

START = 0  # followed by the index of the experiment and the number of the start
FLOOR = 1
EXCITATION = 10
TRIAL = 11
TRAINING = 12


def child(seed: np.random.SeedSequence, *key: int) -> np.random.SeedSequence:
    """Return the stream of a seed that this key names; it is the same at every call."""
    return np.random.SeedSequence(seed.entropy, spawn_key=(*seed.spawn_key, *key))
