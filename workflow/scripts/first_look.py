"""Show two verdicts on a page, with numbers that do not distinguish the two."""

from hopdata.jobs import read_table, reported, whole_file
from hopdata.maps.prediction import error_ratios
from hopdata.recordings.readers.hdf5 import read_truth
from hopdata.report.formatting import count
from hopdata.report.inputs import picture_of, read_figures, rendered
from hopdata.report.tables import excluded

with reported(snakemake.log[0], snakemake.input, snakemake.output):
    source = snakemake.input
    facts = {}
    for number, name in enumerate(snakemake.params.names):
        summary = read_table(source.summaries[number])
        touchdowns = read_table(source.touchdowns[number])
        distances = read_table(source.distances[number]).set_index("kind")
        apart = distances.loc["cross_class", "auc_against_in_class"]
        truth = read_truth(source.recordings[number])
        facts[name] = {
            **error_ratios(summary, touchdowns),
            "apart": float(apart),
            "landings": count((~excluded(touchdowns)).sum()),
            "true": truth.true_effect,
        }
    figures = read_figures(source.figures, [source.captions])
    pictures = [picture_of(figure, facts) for figure in figures]
    page = rendered("first_look.html.j2", pictures=pictures)
    with whole_file(snakemake.output[0]) as draft:
        draft.write_text(page, encoding="utf-8")
