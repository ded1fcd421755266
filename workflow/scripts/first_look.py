"""Put the verdicts on two studies on a page, with the numbers that do not tell them apart."""

from hopdata.jobs import read_json, read_table, reported, whole_file
from hopdata.maps.prediction import error_ratios
from hopdata.maps.truth.maps import true_effect
from hopdata.recordings.readers.hdf5 import read_truth
from hopdata.report.inputs import picture_of, read_figures, rendered
from hopdata.synthesis.landings import SectionHeights
from hopdata.synthesis.scaling import common_scene, exact_maps, true_states


def true_difference(recording, sections):
    """Return the difference of the exact maps of a simulated recording."""
    truth, found = read_truth(recording), read_json(sections)
    scene = common_scene([truth])
    body = scene.points_of(snakemake.params.body)
    heights = SectionHeights(found["pre_height_m"], found["post_height_m"], body)
    states = true_states(truth, scene, heights)
    return true_effect(exact_maps([truth], heights), states.x, truth.contact_times)


with reported(snakemake.log[0]):
    source = snakemake.input
    facts = {}
    tables = zip(source.summaries, source.distances, source.touchdowns, strict=True)
    known = zip(source.recordings, source.sections, strict=True)
    for name, paths, truth in zip(snakemake.params.names, tables, known, strict=True):
        summary, distances, touchdowns = map(read_table, paths)
        apart = distances.set_index("kind").loc["cross_class", "auc_against_in_class"]
        facts[name] = error_ratios(summary, touchdowns) | {
            "apart": float(apart),
            "true": true_difference(*truth),
        }
    pictures = [
        picture_of(figure, facts) for figure in read_figures(source.figures, [source.captions])
    ]
    with whole_file(snakemake.output[0]) as file:
        file.write_text(rendered("first_look.html.j2", pictures=pictures), encoding="utf-8")
