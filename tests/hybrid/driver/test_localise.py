"""The Hermite cubic against NumPy's polynomials."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest
from hybrid_systems import bumping_pair, table_ball

from hopdata.hybrid import solve
from hopdata.hybrid.driver import localise as localisation
from hopdata.hybrid.driver.localise import cubic, cubic_root, way_to_root
from hopdata.hybrid.layout import (
    CLOCK_SLOTS,
    COUNT_SLOTS,
    GUARD_ROWS,
    H0,
    H1,
    RATE,
    RATE0,
    RATE1,
    SIZE,
    ZENO,
    H,
)


def ends(polynomial):
    slope = polynomial.deriv()
    return polynomial(0.0), slope(0.0), polynomial(1.0), slope(1.0)


@pytest.fixture
def rng():
    return np.random.default_rng(11)


def test_value(rng):
    for coefficients in rng.normal(size=(50, 4)):
        polynomial = np.polynomial.Polynomial(coefficients)
        x = rng.uniform()
        assert cubic(*ends(polynomial), x) == pytest.approx(polynomial(x), abs=1e-13)


def test_root(rng):
    for _ in range(100):
        a = rng.uniform(0.1, 0.9)
        c = rng.uniform(1.1, 3.0)
        polynomial = np.polynomial.Polynomial.fromroots([a, c, -c]) * rng.uniform(
            0.1, 10
        )
        assert cubic_root(*ends(polynomial), 0.0, 1.0) == pytest.approx(a, rel=1e-6)


def test_root_past_a_top_that_the_search_begins_before():
    polynomial = np.polynomial.Polynomial.fromroots([0.0, 0.0, 0.9]) * -1.0
    assert polynomial.deriv()(0.5) > 0
    assert cubic_root(*ends(polynomial), 0.0, 1.0) == pytest.approx(0.9, rel=1e-6)


# The first flip in a step: a guard that has just flipped does not flip back because of
# rounding.

ROUNDING = 1e-16


def memory_of(guards):
    """Return the part of the driver's memory that a search reads: a step from 0 s."""
    clock = np.zeros(CLOCK_SLOTS)
    counts = np.zeros(COUNT_SLOTS, dtype=int)
    return SimpleNamespace(guards=guards, clock=clock, counts=counts)


def interpret(monkeypatch):
    """Let `crossing` call what it uses as Python, so that the guards may be functions.

    Returns the search up to the end of the step, from a first guess.
    """
    for name in ("leave", "just_left", "margin_of"):
        monkeypatch.setattr(localisation, name, getattr(localisation, name).py_func)

    def search(problem, memory, guess):
        monkeypatch.setattr(localisation, "guess_between", lambda *_: guess)
        return localisation.crossing.py_func(problem, memory, 1.0, 0, 0.0, 1.0, H1)

    return search


@pytest.fixture
def search(monkeypatch):
    """Return `crossing` for a margin and its slope, as functions of the fraction of the step."""
    begin = interpret(monkeypatch)

    def found(margin, slope, guess):
        guards = np.zeros((GUARD_ROWS, 1))
        guards[[H0, H1]] = [[margin(0.0)], [margin(1.0)]]
        guards[[RATE0, RATE1]] = [[slope(0.0)], [slope(1.0)]]
        memory = memory_of(guards)

        def probe(p, m, dt, k, theta):
            guards[H] = margin(theta)
            guards[RATE] = slope(theta)

        monkeypatch.setattr(localisation, "probe", probe)
        return begin(SimpleNamespace(mode=np.array([1])), memory, guess)

    return found


@pytest.mark.parametrize("location", [0.1, 0.3, 0.7155111958385192, 0.95])
@pytest.mark.parametrize(
    ("above", "below"), [(0.33122, 3.4427e-6), (1e-3, 1e-3), (1e-6, 0.3)]
)
def test_an_event_function_that_jumps_is_past_its_surface_there(
    search, location, above, below
):
    def margin(x):
        return (
            above - 0.0734 * (x - location)
            if x < location
            else -below - 4.999 * (x - location)
        )

    def slope(x):
        return -0.0734 if x < location else -4.999

    for guess in np.linspace(0.05, 0.95, 19):
        assert search(margin, slope, guess) == pytest.approx(location, abs=1e-12)


def test_two_roots_that_nearly_meet_are_told_apart(search):
    a = 0.9376424853
    b = 0.9376424853 - 2.2e-6
    e = 0.95377

    def margin(x):
        return -(x - a) * (x - b) * (x - e)

    def slope(x):
        return -((x - b) * (x - e) + (x - a) * (x - e) + (x - a) * (x - b))

    for guess in (0.93, 0.936, 0.9376, 0.94):
        location = search(margin, slope, guess)
        assert min(abs(location - root) for root in (a, b, e)) < 1e-8


def test_rates_that_contradict_the_function_lead_to_no_location_before_its_surface(
    search,
):
    location = 0.1388553

    def margin(x):
        return 2.0130e-7 if x < location else -2.9208e-5

    def slope(x):
        return 0.0760 if x < location else -0.00266

    for guess in (0.1, 0.5, 0.9):
        assert location <= search(margin, slope, guess) <= 1.0


@pytest.fixture
def interpreted(monkeypatch):
    """Return `crossing` for a guard that leaves its surface and meets it again at 0.5 of the step.

    Near the start h is lost in rounding, so the guard seems to be just past the surface
    there.
    """
    guards = np.zeros((GUARD_ROWS, 1))
    guards[H0] = -ROUNDING
    guards[RATE0] = -0.5
    guards[SIZE] = 1.0
    memory = memory_of(guards)
    problem = SimpleNamespace(mode=np.array([-1]))

    def probe(p, m, dt, k, theta):
        margin = theta * (0.5 - theta)
        guards[H] = ROUNDING if theta < 2 * ROUNDING else -margin
        guards[RATE] = -(0.5 - 2.0 * theta)

    monkeypatch.setattr(localisation, "probe", probe)
    begin = interpret(monkeypatch)
    return lambda guess: begin(problem, memory, guess)


@pytest.mark.parametrize("guess", [0.45, 0.9, 1e-3, 1e-13, 1e-16])
def test_no_guess_leads_back_to_the_flip_before(interpreted, guess):
    assert interpreted(guess) == pytest.approx(0.5, rel=1e-8)


def test_a_steep_exponential_is_not_walked_down(search):
    """Newton's method moves by a thousandth of the step, a thousand times."""

    def margin(x):
        return 1e-3 - np.exp(1000.0 * (x - 0.9))

    def slope(x):
        return -1000.0 * np.exp(1000.0 * (x - 0.9))

    truth = 0.9 + np.log(1e-3) / 1000.0
    for guess in (0.1, 0.5, 0.999):
        assert search(margin, slope, guess) == pytest.approx(truth, rel=1e-12)


def swing(x):
    """Return a margin and its slope that fall through zero at 0.7, as part of an oscillation."""
    return np.sin(3.0 * (0.7 - x)), -3.0 * np.cos(3.0 * (0.7 - x))


@pytest.mark.parametrize("far", [0.2, 0.1, 0.05, -0.05, -0.1])
def test_the_way_to_the_root_is_as_exact_as_two_locations_allow(far):
    for near in (1e-2, -1e-2, 1e-3, -1e-3):
        x = 0.7 + near
        x1 = 0.7 + far
        way, exact = way_to_root(x, *swing(x), x1, *swing(x1))
        assert abs(x + way - 0.7) < 10.0 * (near * far) ** 2
        assert not exact or abs(x + way - 0.7) < 1e-15


def test_where_the_cubic_turns_newton_shows_the_way():
    x = 0.5
    g = 0.1
    d = -0.1
    assert way_to_root(x, g, d, 0.6, 0.2, 1.0) == (pytest.approx(1.0), False)


@pytest.mark.parametrize("seed", range(4))
def test_a_ball_that_comes_to_rest_on_a_shaking_table_never_falls_through_it(seed):
    """Its last flights are lower than the rounding of h, as terms cancel: Zeno, or no event yet."""
    rng = np.random.default_rng(seed)
    statuses = set()
    end = 3.0
    for _ in range(50):
        size, rate, rtol = (
            10.0 ** rng.uniform(*span) for span in ((-3, -1), (0.5, 2), (-11, -5))
        )
        height = rng.choice([0.0, 1.0, -30.0])
        bounce = rng.uniform(0.2, 0.8)
        ball = solve(
            table_ball(), (0.0, end), [height + size + 0.3, 0.0],
            params=[9.81, height, size, rate, bounce], rtol=rtol, t_eval=np.linspace(0.0, end, 301),
        )  # fmt: skip
        statuses.add(ball.status)
        assert (height + size * np.sin(rate * ball.t) - ball.y[0]).max() < 1e-6, (
            ball.message
        )
    assert statuses == {0, ZENO}


@pytest.mark.parametrize("seed", range(4))
def test_bodies_that_come_to_rest_on_each_other_anywhere_and_on_the_way_are_told(seed):
    """The attraction between them is small compared with their positions and speeds."""
    rng = np.random.default_rng(seed)
    statuses = set()
    for _ in range(50):
        location = rng.choice([0.0, 1.0, 1e3, -1e5])
        speed = rng.choice([0.0, 0.3, -20.0])
        pull = 10.0 ** rng.uniform(-1, 1)
        bounce = rng.uniform(0.1, 0.9)
        rtol = 10.0 ** rng.uniform(-11, -5)
        pair = solve(
            bumping_pair(), (0.0, 4.0), [location, location + rng.uniform(0.1, 1.0), speed, speed],
            params=[pull, bounce], rtol=rtol, t_eval=np.linspace(0.0, 4.0, 201),
        )  # fmt: skip
        statuses.add(pair.status)
        assert (pair.y[0] - pair.y[1]).max() < 1e-9 * max(1.0, abs(location)), (
            pair.message
        )
    assert statuses == {0, ZENO}
