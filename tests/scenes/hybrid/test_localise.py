"""Springs of the plate that are nearly grazed."""

from __future__ import annotations

import pytest

from hopdata.hybrid import solve
from hopdata.scenes.plate import Plate

# Landings where a spring lets go and soon touches again, by number of springs and of
# the start.
NEARLY_GRAZING = [
    (27, 12),
    (27, 37),
    (27, 147),
    (29, 111),
    (30, 33),
    (33, 100),
    (35, 7),
]


@pytest.mark.parametrize("form", [{}, {"sums": True}, {"sparse": True}])
@pytest.mark.parametrize(("contacts", "start"), NEARLY_GRAZING)
@pytest.mark.parametrize("jacobian", [False, True])
def test_a_spring_that_is_met_again_soon_is_no_zeno_sequence(
    contacts, start, form, jacobian
):
    plate = Plate(contacts)
    y0 = plate.initial_states(150, 444)[start]

    def events_of(**options):
        solution = solve(
            plate.system(**form), (0, 2), y0, params=plate.params, **options
        )
        assert solution.status == 0
        log = solution.events
        return list(zip(log.guard.tolist(), log.direction.tolist(), strict=True))

    coarse = events_of(rtol=1e-6, atol=1e-7, jacobian=jacobian)
    assert len(set(coarse)) >= 2 * contacts - 2
    assert sorted(coarse) == sorted(events_of(rtol=1e-10, atol=1e-11))
