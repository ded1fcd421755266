"""A body that a camera system gives as a whole, as the loop tracks it."""

from types import SimpleNamespace

import numpy as np
import pytest

from hopdata.steering.live.sources.rigid_bodies import _point_of, arm
from hopdata.steering.observation.bodies import BodyTracker, NothingShown, rigid_body


@pytest.mark.parametrize("heading", [-2.0, 0.0, 1.2])
def test_the_points_of_a_rigid_body_show_its_heading_and_its_mean_place(heading):
    geometry = rigid_body("runner", noise_m=5e-4)
    half = heading / 2
    turned = SimpleNamespace(w=np.cos(half), x=0.0, y=0.0, z=np.sin(half))
    body = SimpleNamespace(rotation=turned)
    origin = np.array([1.0, -2.0, 0.7])
    named = [_point_of(label) for label in geometry.body_names]
    assert {name for name, _ in named} == {"runner"}
    markers = np.array([origin + arm(body, point) for _, point in named])
    seen = BodyTracker(geometry, geometry.body_names, NothingShown()).feed(0.0, markers)
    assert seen.known
    np.testing.assert_allclose(seen.pose[:2], markers[:, :2].mean(axis=0), atol=1e-12)
    assert seen.pose[2] == pytest.approx(heading)
