"""Streams of chance of a steering study: first number of the key under the study's seed."""

from __future__ import annotations

START = 0  # then the experiment's place and the number of the start
FLOOR = 1
BOOTSTRAP = 2
EXCITATION = 10
TRIAL = 11
TRAINING = 12  # then the number of the set of hops
