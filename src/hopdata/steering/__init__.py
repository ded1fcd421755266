"""Steering: from recorded hops to a model of the frame change, and a controller that uses it."""

import numpy as np

# How an excitation is drawn and observed: by the dissertation's Algorithms 1 to 4, or as put right.
OBSERVATIONS = CORRECTED, PRINTED = ("corrected", "printed")

# Streams of chance under the seed of an excitation: first number of the key.

START = 0  # then the experiment's place and the number of the start
FLOOR, EXCITATION, TRIAL, TRAINING = 1, 10, 11, 12


def child(seed: np.random.SeedSequence, *key: int) -> np.random.SeedSequence:
    """Return the stream of a seed that this key names, the same at every call."""
    return np.random.SeedSequence(seed.entropy, spawn_key=(*seed.spawn_key, *key))
