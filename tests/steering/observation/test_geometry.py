import json

import numpy as np
import pytest

from hopdata.errors import AnalysisError, RecordingError
from hopdata.steering.observation.geometry import (
    BoomCircle,
    HopperGeometry,
    load_geometry,
)

CIRCLE = BoomCircle(np.array([0.25, 0.0, -0.1]), np.array([0.0, 0.0, 1.0]), 0.25)
BODY = np.array([[0.14, 0.03, 0.0], [-0.07, 0.11, 0.01], [-0.07, -0.14, -0.01]])


def geometry(**changes):
    values = {"boom_name": "boom", "circle": CIRCLE} | changes
    return HopperGeometry(("a", "b", "c"), BODY, 0.0006, 0.35, 0.38, **values)


@pytest.mark.parametrize("changes", [{}, {"boom_name": None, "circle": None}])
def test_a_saved_geometry_is_read_back(tmp_path, changes):
    path = tmp_path / "geometry.json"
    geometry(**changes).save(path)
    found = load_geometry(path)
    assert found.body_names == ("a", "b", "c")
    assert (found.noise_m, found.stance_below_m, found.flight_above_m) == (
        0.0006,
        0.35,
        0.38,
    )
    np.testing.assert_array_equal(found.body_m, BODY)
    assert found.boom_name == geometry(**changes).boom_name
    if found.circle is not None:
        np.testing.assert_array_equal(found.circle.centre_m, CIRCLE.centre_m)
        np.testing.assert_array_equal(found.circle.normal, CIRCLE.normal)
        assert found.circle.radius_m == 0.25


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("format", "another"),
        ("body_m", [[0, 0, 0]]),
        ("body_m", "no"),
        ("noise_m", None),
        ("circle", {"centre_m": [0, 0], "normal": [0, 0, 1], "radius_m": 1}),
        ("circle", {"normal": [0, 0, 1]}),
    ],
)
def test_a_file_with_something_else_is_refused(tmp_path, key, value):
    path = tmp_path / "geometry.json"
    geometry().save(path)
    path.write_text(json.dumps(json.loads(path.read_text()) | {key: value}))
    with pytest.raises(RecordingError, match="expected a hopper geometry"):
        load_geometry(path)


@pytest.mark.parametrize("text", ["", "[]", "{}", "\0"])
def test_a_file_that_is_no_geometry_is_refused(tmp_path, text):
    path = tmp_path / "geometry.json"
    path.write_text(text)
    with pytest.raises(RecordingError, match=r"geometry\.json: expected"):
        load_geometry(path)


def test_a_missing_file_is_refused(tmp_path):
    with pytest.raises(RecordingError, match="expected"):
        load_geometry(tmp_path / "none.json")


def test_markers_are_found_by_name():
    assert geometry().body_places(("boom", "c", "b", "a")) == [3, 2, 1]
    assert geometry().boom_place(("boom", "c", "b", "a")) == 0
    with pytest.raises(
        AnalysisError, match=r"expected the marker 'boom'.*did you mean 'Boom'"
    ):
        geometry().boom_place(("a", "b", "c", "Boom"))


@pytest.mark.parametrize("lean", [0.0, 0.4])
def test_boom_angles_count_from_the_body_x_axis(lean):
    normal = np.array([np.sin(lean) * 0.6, np.sin(lean) * 0.8, np.cos(lean)])
    circle = BoomCircle(CIRCLE.centre_m, normal, 0.25)
    angle = np.linspace(-3, 3, 13)
    x, y = circle.axes
    boom = circle.centre_m + 0.25 * (
        np.cos(angle)[:, None] * x + np.sin(angle)[:, None] * y
    )
    np.testing.assert_allclose(circle.angles(boom), angle, atol=1e-12)
    np.testing.assert_allclose(circle.misses(boom), 0, atol=1e-12)
    np.testing.assert_allclose(circle.misses(boom + 0.03 * normal), 0.03, atol=1e-12)
    assert np.cross(x, y) @ normal == pytest.approx(1.0)
    assert x @ [1, 0, 0] > 0.9
