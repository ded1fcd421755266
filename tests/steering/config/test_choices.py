"""Each choice by name in the block ``steering`` has one table of names."""

import numpy as np
import pytest

from choices import enumerations
from hopdata.config.schema import load_schema
from hopdata.steering import OBSERVATIONS
from hopdata.steering.experiments import tasks
from hopdata.steering.models import training as models

# For each table, a call with a name that it may not know.
ASKED = {
    "model.kernel": (models.KERNELS, lambda name: models.process_of({"kernel": name})),
    "experiment": (
        tasks.EXPERIMENTS,
        lambda name: tasks.draw_starts(
            name, 1, distance_m=1.0, seed=np.random.SeedSequence(0)
        ),
    ),
}
# Choices of the configuration, and the tables of the modules that use them. The schema
# repeats the names, so that a study that only reads it does not import steering.
CONFIGURED = {
    "model.kernel": models.KERNELS,
    "experiments.controllers": tasks.CONTROLLERS,
    "observations": OBSERVATIONS,
}


@pytest.mark.parametrize("choice", ASKED)
def test_an_unknown_name_is_an_error_that_lists_the_known_ones(choice):
    table, ask = ASKED[choice]
    with pytest.raises(Exception, match="expected one of ") as caught:
        ask("no such name")
    assert all(str(name) in str(caught.value) for name in table)
    assert "no such name" in str(caught.value)
    assert "hopdata" in caught.type.__module__


def test_the_choices_of_the_block_are_those_of_the_tables():
    block = load_schema()["properties"]["steering"]
    assert dict(enumerations(block)) == {
        path: list(table) for path, table in CONFIGURED.items()
    }
