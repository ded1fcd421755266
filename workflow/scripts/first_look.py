"""Show the verdicts on two studies on a page, with the numbers that do not distinguish the two."""

from hopdata.jobs import read_table, reported, whole_file
from hopdata.maps.prediction import error_ratios
from hopdata.recordings.readers.hdf5 import read_truth
from hopdata.report.inputs import picture_of, read_figures, rendered

with reported(snakemake.log[0]):
    source = snakemake.input
    facts = {}
    tables = zip(source.summaries, source.distances, source.touchdowns, strict=True)
    for name, paths, recording in zip(
        snakemake.params.names, tables, source.recordings, strict=True
    ):
        summary, distances, touchdowns = map(read_table, paths)
        apart = distances.set_index("kind").loc["cross_class", "auc_against_in_class"]
        facts[name] = error_ratios(summary, touchdowns) | {
            "apart": float(apart),
            "true": read_truth(recording).true_effect,
        }
    pictures = [
        picture_of(figure, facts)
        for figure in read_figures(source.figures, [source.captions])
    ]
    with whole_file(snakemake.output[0]) as file:
        file.write_text(
            rendered("first_look.html.j2", pictures=pictures), encoding="utf-8"
        )
