"""Compute true marker states at the sections, and the exact linear maps between them."""

import numpy as np

from hopdata.jobs import read_json, reported, write_json
from hopdata.landings.states.pairs import Pairs, write_pairs
from hopdata.recordings.readers.hdf5 import read_truth
from hopdata.synthesis.landings import SectionHeights
from hopdata.synthesis.scaling import common_scene, exact_maps, true_states

with reported(snakemake.log[0]):
    found, body = read_json(snakemake.input.sections), snakemake.params.markers["body"]
    truths = [read_truth(path) for path in snakemake.input.recordings]
    scene = common_scene(truths)
    sections = SectionHeights(
        found["pre_height_m"], found["post_height_m"], scene.points_of(body)
    )
    states = [true_states(truth, scene, sections) for truth in truths]
    names = [
        name
        for name, s in zip(snakemake.params.recordings, states, strict=True)
        for _ in s.x
    ]
    columns = {
        name: np.concatenate([getattr(s, name) for s in states])
        for name in ("x", "y", "schedule", "spread_s", "index")
    }
    pairs = Pairs(**columns, recording=np.array(names), body_markers=tuple(body))
    write_pairs(snakemake.output.pairs, pairs)
    write_json(snakemake.output.maps, exact_maps(truths, sections))
