"""Three feet that fall freely and independently onto a floor: landings with exact contacts."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from hopdata.landings.contacts.descents import Transitions

FloatArray = NDArray[np.float64]

RATE_HZ, NOISE_M, SPEED_M_S, GRAVITY_M_S2 = 100.0, 6e-4, 1.0, 9.80665
FRAMES = 50


@dataclass(frozen=True)
class Falls:
    """Frames (N,), heights (N, 3), true contacts (L, 3) and the transitions about them."""

    time: FloatArray
    heights: FloatArray
    contacts: FloatArray
    transitions: Transitions


def falls(
    landings: int,
    *,
    seed: int,
    apart_s: float | None = None,
    missing: int = 0,
    compliance_s: float = 0.0,
    kept: float = 1.0,
    creep_m_s: float = 0.0,
    stands_s: float = np.inf,
    push_m_s2: float = 0.0,
    strike_m_s: float = 0.0,
    noise_m: float = NOISE_M,
) -> Falls:
    """Simulate landings with contacts from N(0, 10 ms) or at fixed distances, in random order.

    `missing` frames about each contact are unseen, and a foot leaves the floor after
    `stands_s`. It keeps a share of its speed as it lands if the contact is soft. Each standing foot pushes the others up, and slows them by `strike_m_s`
    as it lands.
    """
    rng = np.random.default_rng(seed)
    time = np.arange(landings * FRAMES) / RATE_HZ
    offsets = rng.normal(0, 0.01, (landings, 3))
    if apart_s is not None:
        offsets = rng.permuted(np.tile([-apart_s, 0.0, apart_s], (landings, 1)), axis=1)
    middle = (
        0.3
        + FRAMES / RATE_HZ * np.arange(landings)
        + rng.uniform(0, 1 / RATE_HZ, landings)
    )
    contacts = middle[:, None] + offsets
    s = time.reshape(landings, FRAMES, 1) - contacts[:, None, :]
    after = np.maximum(s, 0.0)
    sunk = creep_m_s * after
    if compliance_s > 0:
        sunk -= kept * SPEED_M_S * compliance_s * (1 - np.exp(-after / compliance_s))
    height = np.where(s < 0, -SPEED_M_S * s - GRAVITY_M_S2 * s**2 / 2, sunk)
    height += SPEED_M_S * np.maximum(s - stands_s, 0.0)
    waits = np.maximum(contacts[:, :, None] - contacts[:, None, :], 0.0)[:, None]
    pushed = (after[:, :, None] ** 2 - waits**2) / 2 - s[..., None] * waits
    height += push_m_s2 * np.where(s < 0, pushed.sum(axis=3), 0.0)
    struck = after[:, :, None] - waits
    height += strike_m_s * np.where(s < 0, struck.sum(axis=3), 0.0)
    height += rng.normal(0, noise_m, height.shape)
    if missing:
        nearest = np.abs(s).argmin(axis=1)[:, None]
        height[np.abs(np.arange(FRAMES)[:, None] - nearest) <= missing // 2] = np.nan
    gap = np.full(landings, 1 / RATE_HZ)
    ends = contacts.min(axis=1) - 0.05, contacts.max(axis=1) + 0.02
    return Falls(time, height.reshape(-1, 3), contacts, Transitions(*ends, gap, gap))
