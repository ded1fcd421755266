"""What distances between subspaces are without any data: equal but noisy, or unrelated ones.

The dissertation compares with "noised identical matrices ... with a signal-to-noise ratio of 10"
(Sec. 2.3) and does not say what is noised or how the ratio is counted. `READINGS` has every way to
read it; the one that is taken for Fig. 2.5 gives distances like the printed ones.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hopdata.errors import chosen
from hopdata.maps.subspaces.grassmann import arc_length, orthonormalised

# Powers of the ratio, and of the number of rows, by which the noise of an entry goes.
RATIOS = {"amplitude": -1.0, "power": -0.5}
SIGNALS = {"entry": 0.0, "matrix": -0.5}
#: The signal-to-noise ratio that is printed.
PRINTED_SNR = 10.0

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Reading:
    """One way to read "a signal-to-noise ratio of 10".

    Attributes
    ----------
    ratio
        ``amplitude``: the noise is 1/10 of the signal; ``power``: 1/10 of its power, or 10 dB.
    signal
        ``entry``: the ones of the identity; ``matrix``: the rms of all its entries, zeros
        included, so that the ratio is that of Frobenius norms (or of the norms of columns).
    noised
        How many of the two matrices of a pair have noise.
    """

    ratio: str
    signal: str
    noised: int

    def noise_sd(self, shape: tuple[int, int], snr: float = PRINTED_SNR) -> float:
        """Return the sd of the noise on each entry of a (D, k) identity."""
        level = snr ** chosen("ratio", self.ratio, RATIOS)
        return level * shape[0] ** chosen("signal", self.signal, SIGNALS)


READINGS = tuple(
    Reading(ratio, signal, noised) for ratio in RATIOS for signal in SIGNALS for noised in (2, 1)
)
#: Noise of sd 0.1 on every entry of both matrices: the reading of Fig. 2.5.
PRINTED_READING = READINGS[0]


def noised_identities(
    generator: np.random.Generator,
    shape: tuple[int, int],
    count: int,
    noise_sd: float,
    noised: int = 2,
) -> tuple[Floats, Floats]:
    """Return (count, D, k) bases of pairs of identities with normal noise on each entry.

    Of a pair, `noised` have noise, independent of each other; both are orthonormalised.
    """
    noise = noise_sd * generator.standard_normal((2, count, *shape))
    noise[noised:] = 0.0
    a, b = orthonormalised(np.eye(*shape) + noise)
    return a, b


def random_subspaces(
    generator: np.random.Generator, shape: tuple[int, int], count: int
) -> tuple[Floats, Floats]:
    """Return (count, D, k) bases of pairs of uniform (Haar) random subspaces."""
    a, b = orthonormalised(generator.standard_normal((2, count, *shape)))
    return a, b


def noised_identity(
    generator: np.random.Generator,
    shape: tuple[int, int],
    count: int,
    noise_sd: float,
    noised: int = 2,
) -> Floats:
    """Return arc lengths of `count` pairs: see `noised_identities`."""
    return arc_length(*noised_identities(generator, shape, count, noise_sd, noised))


def random(generator: np.random.Generator, shape: tuple[int, int], count: int) -> Floats:
    """Return arc lengths of `count` pairs: see `random_subspaces`."""
    return arc_length(*random_subspaces(generator, shape, count))
