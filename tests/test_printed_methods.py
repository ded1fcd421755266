"""Each printed variant of the study runs from its key, and gives something else."""

import numpy as np
import pytest

import hopdata as hd
from hopdata.config.schema import printed_keys


def errors(table):
    return table.select_dtypes("number").to_numpy()


def distances(study):
    return errors(study.constraint_subspaces().distances)


# Result by which each key is told to have run.
RUNS = {
    "sections.rule": lambda study: study.sections.pre_height_m,
    "touchdowns.method": lambda study: study.touchdowns["contact_foot1_s"].to_numpy(),
    "states.method": lambda study: study.pairs.x,
    "prediction.draws": lambda study: errors(study.prediction().prediction_errors),
    "subspaces.which": distances,
    "subspaces.draws": distances,
    "subspaces.incomplete": distances,
}

# Keys of what is simulated, which decide nothing about a recording that is given:
# tests/synthesis/test_integrators.py has what they change.
SIMULATED = {"simulation.integrator"}
# Keys that decide something only beside another.
BESIDE = {"subspaces.incomplete": {"subspaces.draws": "resampled"}}
# Complements are as far apart as the subspaces, so the distances stay.
WITHOUT_EFFECT = {"subspaces.which"}

# Small enough for a short recording.
SMALL = {
    "prediction": {"bootstraps": 10, "train": 20, "test": 5, "minimum_class": 10},
    "subspaces": {"bootstraps": 10, "samples": 25},
    "distances": {"pairs": 10},
}


@pytest.fixture(scope="module")
def recording():
    found, _ = hd.synthesize(simulation={"hops": 180}, seed=4)
    return found


def studied(recording, **keys):
    blocks = {name: dict(block) for name, block in SMALL.items()}
    for path, value in keys.items():
        block, _, name = path.partition(".")
        blocks.setdefault(block, {})[name] = value
    return hd.study(recording, **blocks)


def keys_of_the_study():
    """Return the printed keys without those of products, which have their own tests."""
    products = {"steering", "dissertation"}
    return {
        path: value
        for path, value in printed_keys().items()
        if path.partition(".")[0] not in products
    }


def test_every_printed_key_of_the_study_is_run_here():
    assert set(RUNS) | SIMULATED == set(keys_of_the_study())
    assert not set(RUNS) & SIMULATED


@pytest.fixture(scope="module")
def usual(recording):
    return studied(recording)


@pytest.mark.parametrize("path", RUNS)
def test_each_printed_variant_runs_from_its_key(recording, usual, path):
    beside = BESIDE.get(path, {})
    without = studied(recording, **beside) if beside else usual
    expected = RUNS[path](without)
    printed = RUNS[path](studied(recording, **beside, **{path: printed_keys()[path]}))
    assert np.isfinite(printed).mean() > 0.9
    if path in WITHOUT_EFFECT:
        np.testing.assert_allclose(printed, expected, atol=1e-6)
    else:
        assert not np.array_equal(printed, expected, equal_nan=True)


@pytest.mark.parametrize("path", sorted(SIMULATED))
def test_a_simulated_study_runs_from_each_key_of_what_is_simulated(path):
    block, _, name = path.partition(".")
    keys = {"hops": 30, "duration_s": 15.0}
    made = {
        value: hd.synthesize(**{block: {**keys, name: value}}, seed=4)
        for value in ("driver", printed_keys()[path])
    }
    (usual, _), (printed, truth) = made.values()
    contacts = [
        hd.study(one).touchdowns[["contact_foot1_s", "contact_foot2_s"]].to_numpy()
        for one in (usual, printed)
    ]
    assert len(contacts[1]) > 15
    # What is simulated is the same but for the method's errors; the noise is the same.
    assert np.nanmax(np.abs(contacts[0] - contacts[1])) < 1e-4
    assert f'"{name}": "{printed_keys()[path]}"' in truth.parameters_json


def test_the_one_key_asks_for_all_of_them(recording):
    whole = hd.study(recording, printed=True, **SMALL).config
    each = studied(recording, **keys_of_the_study()).config
    products = {"steering", "dissertation", "printed"}
    for block in set(whole) - products:
        assert whole[block] == each[block], block
    assert (whole["printed"], each["printed"]) == (True, False)
