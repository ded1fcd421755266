"""Systems of all scenes are pickled."""

from __future__ import annotations

import pickle

import pytest

from hopdata.scenes import SCENES, scene_class


@pytest.mark.parametrize("name", sorted(SCENES))
def test_systems_of_scenes(name):
    system = scene_class(name)().system()
    assert pickle.loads(pickle.dumps(system)) == system
