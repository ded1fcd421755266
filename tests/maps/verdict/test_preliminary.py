"""What a study says that is refused a verdict."""

import numpy as np
import pytest

from hopdata.errors import AnalysisError
from hopdata.maps.verdict import judge
from hopdata.maps.verdict.judge import Verdict
from hopdata.maps.verdict.preliminary import preliminary

SHAPE = 0.1 * np.array([[1.0, 0.0, 0.0], [-0.5, 0.9, 0.0], [-0.5, -0.9, 0.1]])
FEET = np.array([[0.3, 0.0], [-0.15, 0.26], [-0.15, -0.26]])


def landings(n, *, legs_m=0.0, seed=1):
    """Return states and instants: the lower a foot of the tilted body, the earlier."""
    rng = np.random.default_rng(seed)
    tilt = 0.05 * rng.standard_normal((n, 2))
    speed = np.array([0.2, 0.1, -1.0]) + 0.1 * rng.standard_normal((n, 3))
    spin = 0.3 * rng.standard_normal((n, 3))
    # Small turns about x and y.
    raised = SHAPE[:, 1] * tilt[:, :1] - SHAPE[:, 0] * tilt[:, 1:]
    place = np.broadcast_to(SHAPE, (n, 3, 3)).copy()
    place[:, :, 2] += raised
    velocity = speed[:, None] + np.cross(spin[:, None], place)
    heights = FEET[:, 1] * tilt[:, :1] - FEET[:, 0] * tilt[:, 1:]
    heights = heights + legs_m * rng.standard_normal((n, 3))
    instants = heights / -speed[:, 2:]
    x = np.hstack([place.reshape(n, -1), velocity.reshape(n, -1)])
    y = x + 0.01 * rng.standard_normal(x.shape)
    return x, y, instants, heights


def test_what_the_body_foretells_is_told_of_few_landings():
    x, y, instants, _ = landings(40)
    found = preliminary(x, y, instants, instants_se=np.full((40, 3), 1e-4))
    assert found.contacts_r2 > 0.97
    assert found.unknown_because == ""
    assert sum(one["landings"] for one in found.orders) == 40
    counts = [one["landings"] for one in found.orders]
    assert counts == sorted(counts, reverse=True)
    assert 3 <= len(found.orders) <= 6
    assert found.least_landings == 150


def test_legs_that_scatter_are_foretold_by_feet_alone():
    x, y, instants, heights = landings(60, legs_m=0.02)
    feet = np.zeros((60, 3, 3))
    feet[:, :, 2] = heights
    by_body = preliminary(x, y, instants).contacts_r2
    by_feet = preliminary(x, y, instants, feet=feet).contacts_r2
    assert by_body < 0.6
    assert by_feet > 0.9
    feet[0, 0] = np.nan  # a foot that is hidden once: the body alone tells
    assert preliminary(x, y, instants, feet=feet).contacts_r2 == by_body


def test_one_order_that_never_changes_is_not_foretold():
    """All feet are apart by much more than errors, but alike in all landings."""
    x, y, _, _ = landings(40)
    noise = 1e-3 * np.random.default_rng(2).standard_normal((40, 3))
    instants = np.array([0.0, 0.02, 0.04]) + noise
    se = np.full((40, 3), 1e-3)
    found = preliminary(x, y, instants, instants_se=se)
    assert found.orders == ({"order": "1 → 2 → 3", "landings": 40},)
    named = preliminary(
        x, y, instants, instants_se=se, foot_names=("toe", "heel", "thumb")
    )
    assert named.orders == ({"order": "toe → heel → thumb", "landings": 40},)
    assert (found.contacts_r2, found.unknown_because) == (None, "errors")
    assert "hardly more" in str(found.said())
    # Without errors of such a size their scatter counts, and nothing foretells it.
    sure = preliminary(x, y, instants, instants_se=0.1 * se)
    assert sure.contacts_r2 == pytest.approx(0.0, abs=0.15)


def test_too_few_landings_and_no_body_leave_the_orders():
    x, y, instants, _ = landings(40)
    few = preliminary(x[:10], y[:10], instants[:10])
    assert (few.contacts_r2, few.unknown_because) == (None, "few")
    assert sum(one["landings"] for one in few.orders) == 10
    loose = preliminary(np.ones_like(x), np.ones_like(y), instants)
    assert (loose.contacts_r2, loose.unknown_because) == (None, "states")


def test_a_refusal_carries_it_and_an_answer_does_not():
    x, y, instants, _ = landings(40)
    told = judge(x, y, instants, seed=1)
    assert told.conclusion == "cannot tell"
    assert told.effect is None
    assert told.preliminary["least_landings"] == 150
    assert "150 landings" in told.outlook
    order = told.preliminary["orders"][0]
    assert f"{order['order']} ({order['landings']})" in told.contacts
    assert told.messages["contacts"].code == "maps.so_far_foretold"

    # A file of an earlier version has other names.
    content = told.to_dict()
    earlier = dict(content)
    for old, new in (("foretold", "contacts_r2"), ("mainly", "main_contrast")):
        earlier[old] = earlier.pop(new)
    inner = dict(earlier.pop("preliminary"))
    inner["foretold"] = inner.pop("contacts_r2")
    inner["untold"] = inner.pop("unknown_because")
    assert Verdict.from_dict(earlier | {"so_far": inner}) == Verdict.from_dict(content)
    with pytest.raises(AnalysisError, match="of another version of hopdata"):
        Verdict.from_dict(earlier)

    x, y, instants, _ = landings(400)
    assert judge(x, y, instants, seed=1).preliminary == {}
    unknown = np.full_like(instants, np.nan)
    assert judge(x, y, unknown, seed=1).preliminary == {}
