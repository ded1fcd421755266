"""How exactly a contact instant can be known at all: the Cramer-Rao bound of the kink.

No unbiased estimate from the same frames has a smaller standard deviation than the inverse of the
Fisher information of the instant and of all else that is unknown with it.
"""

from __future__ import annotations

import numpy as np

from hopdata.arrays import GRAVITY_M_S2, FloatArray

PHASES = 100


def kink_bound(
    s: FloatArray,
    *,
    noise_m: float,
    velocity_m_s: float,
    known_gravity: bool,
    compliance_s: float = 0.0,
    creep_m_s: float = 0.0,
) -> float:
    """Least standard deviation of a contact instant, s, from frames `s` seconds after it.

    Floor and velocity are unknown with it, and the acceleration in flight unless it is gravity;
    compliance and creep are known.

    Parameters
    ----------
    s : (N,) array
        Times of the frames from the contact on, s; negative in flight.
    noise_m : float
        Standard deviation of a height, m.
    velocity_m_s : float
        Vertical velocity just before the contact, m/s, negative.
    known_gravity : bool
        Whether the acceleration is known.
    compliance_s, creep_m_s : float
        See `hopdata.landings.contacts.kink`.

    Returns
    -------
    float
        Infinite where the frames do not fix the instant.
    """
    flight = s < 0
    decay = np.zeros_like(s)
    if compliance_s > 0:
        decay = np.exp(-np.maximum(s, 0.0) / compliance_s)
    by_instant = np.where(
        flight, GRAVITY_M_S2 * s - velocity_m_s, -velocity_m_s * decay - creep_m_s
    )
    by_velocity = np.where(flight, s, compliance_s * (1 - decay))
    columns = [by_instant, np.ones_like(s), by_velocity]
    if not known_gravity:
        columns.append(np.where(flight, s**2 / 2, 0.0))
    jacobian = np.column_stack(columns)
    scale = np.linalg.norm(jacobian, axis=0)
    jacobian = jacobian / np.where(scale > 0, scale, 1.0)
    information = jacobian.T @ jacobian
    if np.linalg.matrix_rank(information, tol=1e-9) < len(columns):
        return float("inf")
    return noise_m * float(np.sqrt(np.linalg.inv(information)[0, 0]) / scale[0])


def mean_kink_bound(
    *,
    rate_hz: float,
    windows_s: tuple[float, float],
    noise_m: float,
    velocity_m_s: float,
    known_gravity: bool,
    missing_frames: int = 0,
    compliance_s: float = 0.0,
    creep_m_s: float = 0.0,
) -> float:
    """Root mean square of the bound over all phases between contact and frames, s.

    Parameters
    ----------
    rate_hz : float
        Frame rate, Hz.
    windows_s : tuple of float
        Frames used, from the contact minus the one to the contact plus the other, s.
    missing_frames : int
        Odd number of frames about the contact that are not seen, or 0.
    noise_m, velocity_m_s, known_gravity, compliance_s, creep_m_s
        See `kink_bound`.
    """
    before, after = (round(window * rate_hz) for window in windows_s)
    bounds = []
    for phase in (np.arange(PHASES) + 0.5) / PHASES:
        frames = np.arange(-before, after) + phase
        seen = np.abs(np.arange(-before, after) + round(phase)) > (missing_frames - 1) / 2
        seen |= missing_frames == 0
        bounds.append(
            kink_bound(
                frames[seen] / rate_hz,
                noise_m=noise_m,
                velocity_m_s=velocity_m_s,
                known_gravity=known_gravity,
                compliance_s=compliance_s,
                creep_m_s=creep_m_s,
            )
        )
    return float(np.sqrt(np.mean(np.square(bounds))))
