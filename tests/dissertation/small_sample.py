"""A short sample and its control in place of the bundled ones."""

from functools import cache

import hopdata as hd

ROLES = {"feet": ["foot1", "foot2", "foot3"], "body": ["body1", "body2", "body3"]}
KEYS = {
    "home": {"marker": "body1"},
    "prediction": {"bootstraps": 10, "train": 40, "test": 14, "minimum_class": 20},
    "subspaces": {"bootstraps": 20},
}


@cache
def small_sample(hops=420):
    """Return functions in place of `study_of` and `truth_of`."""
    recordings = {}
    truths = {}
    for name, control in {"sample": {}, "control": {"coupling": 0.4}}.items():
        simulation = {"hops": hops, "control": control}
        found, truth = hd.synthesize("hopper", name=name, seed=5, simulation=simulation)
        recordings[name] = hd.Recording.from_arrays(
            found.time, found.positions, found.markers, name=name, **ROLES
        )
        truths[name] = truth
    studies = {
        ("sample", False): hd.study(recordings["sample"], **KEYS),
        ("sample", True): hd.study(recordings["sample"], printed=True, **KEYS),
        ("control", False): hd.study(recordings["control"], **KEYS),
    }

    def study_of(file="config/config.yaml", *, printed=False):
        name = "control" if "control" in file else "sample"
        return studies[name, printed]

    def truth_of():
        return truths["sample"]

    return study_of, truth_of
