"""A foot that glides above the floor has not landed; one that yields has."""

import numpy as np
import pandas as pd
import pytest

from hopdata.landings.contacts.glides import glides
from hopdata.recording import Recording

RATE_HZ = 200.0
CONTACT_S = 0.5


def foot_at(height_m):
    """Return a body 1 m up and a foot that falls until the contact, to this height."""
    time = np.arange(200) / RATE_HZ
    positions = np.zeros((len(time), 4, 3))
    positions[:, :3] = [[0.0, 0.0, 1.0], [0.1, 0.0, 1.0], [0.0, 0.1, 1.0]]
    fall = np.maximum(CONTACT_S - time, 0.0)
    positions[:, 3, 2] = fall + height_m(time - CONTACT_S)
    names = ["a", "b", "c", "heel"]
    return Recording.from_arrays(
        time, positions, names, feet=["heel"], body=["a", "b", "c"]
    )


def told(recording):
    landings = pd.DataFrame({"contact_heel_s": [CONTACT_S]})
    return bool(glides(recording, landings)[0, 0])


@pytest.mark.parametrize("glide_m", [0.0, 0.012, 0.03])
def test_a_foot_that_sinks_on_after_its_kink_glides(glide_m):
    def height_m(after):
        return glide_m * np.clip(1.0 - after / 0.15, 0.0, 1.0)

    assert told(foot_at(height_m)) == (glide_m > 0.0)


@pytest.mark.parametrize("yields_m", [0.005, 0.03])
def test_soles_that_yield_at_once_do_not_glide(yields_m):
    def height_m(after):
        return yields_m * np.clip(1.0 - after / 0.03, 0.0, 1.0)

    assert not told(foot_at(height_m))


def test_a_foot_that_bounces_has_landed():
    def height_m(after):
        return np.maximum(0.0, 0.5 * after - 0.5 * 9.81 * after**2)

    assert not told(foot_at(height_m))


def test_a_foot_that_is_hidden_afterwards_tells_nothing():
    def height_m(after):
        return np.where(after > 0.0, np.nan, 0.0)

    assert not told(foot_at(height_m))
