"""The systems of the comparison: the same for all packages, with ends that are known."""

import runpy
from math import exp, log, sqrt

import numpy as np
import pytest
from side import ours, scenes, scipy_side
from side_by_side import NAMES, PROGRAMS, lines, lines_of

from hopdata.hybrid import solve

SCENES = {scene.name: scene for scene in scenes()}


def test_the_ball_ends_where_a_formula_says():
    gravity, restitution, left = 9.8, 0.8, 25.0
    time, speed = sqrt(2.0 * 50.0 / gravity), sqrt(2.0 * gravity * 50.0)
    bounces = 0
    while left > time:
        left -= time
        speed *= restitution
        time = 2.0 * speed / gravity
        bounces += 1
    end = [speed * left - 0.5 * gravity * left**2, speed - gravity * left]
    scene = SCENES["bouncing_ball"]
    np.testing.assert_allclose(scene.end, end, rtol=1e-12)
    assert scene.events == bounces


def test_the_thermostat_ends_where_a_formula_says():
    """The room goes to 25 degrees with the heating on, and to 15 with it off."""
    to_warm = 10.0 * log(5.0 / 4.0)
    half_a_period = 10.0 * log(6.0 / 4.0)  # as long in both directions
    flips = 1 + int((60.0 - to_warm) / half_a_period)
    since = 60.0 - to_warm - (flips - 1) * half_a_period
    end = 15.0 + 6.0 * exp(-0.1 * since)
    if flips % 2 == 0:
        end = 25.0 - 6.0 * exp(-0.1 * since)
    scene = SCENES["thermostat"]
    np.testing.assert_allclose(scene.end, [end], rtol=1e-12)
    assert scene.events == flips


@pytest.mark.parametrize("name", SCENES)
def test_ours_reaches_the_end_with_all_events(name):
    scene, mine = SCENES[name], ours.SYSTEMS[name]()
    found = solve(
        mine.system, scene.t_span, scene.y0, rtol=1e-12, atol=1e-12, **mine.options
    )
    assert found.status == 0
    assert found.n_events == scene.events
    np.testing.assert_allclose(found.y_end, scene.end, rtol=1e-6, atol=1e-7)


@pytest.mark.parametrize("name", ["bouncing_ball", "stick_slip", "boost_converter"])
def test_scipy_integrates_the_same_system(name):
    scene = SCENES[name]
    plain = next(one for one in scipy_side.solvers(scene) if one.method == "DOP853")
    end, count = plain.prepare(1e-9)()
    assert count == scene.events
    np.testing.assert_allclose(end, scene.end, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize("package", ["hopdata", "scipy"])
@pytest.mark.parametrize("name", NAMES)
def test_a_users_program_prints_the_end(capsys, name, package):
    runpy.run_path(str(PROGRAMS / f"{name}_{package}.py"))
    printed = np.array(capsys.readouterr().out.split(), dtype=float)
    np.testing.assert_allclose(printed, SCENES[name].end, rtol=1e-5)


def test_lines_are_those_of_code(tmp_path):
    program = tmp_path / "program.py"
    program.write_text("# a remark\n\nx = 1\n    # another\ny = 2  # and one\n")
    assert lines_of(program) == 2
    assert (lines().drop(columns="system") > 5).all(axis=None)
