"""Draw Figs. 3.5, 3.6, 3.8 and 3.9, and the outcomes of all controllers."""

from pathlib import Path

from hopdata.figures.style import save_figure
from hopdata.figures.steering import steering_outcomes_figure
from hopdata.figures.steering import steering_run_figure
from hopdata.jobs import read_table, reported

with reported(snakemake.log[0]):
    examples = read_table(snakemake.input.examples)
    figures = {
        name: steering_run_figure(examples[examples["experiment"] == experiment])
        for name, experiment in snakemake.params.shows.items()
    }
    figures["steering_outcomes"] = steering_outcomes_figure(
        read_table(snakemake.input.outcomes), read_table(snakemake.input.runs)
    )
    for name, figure in figures.items():
        base = Path(snakemake.output[0]).with_name(name)
        save_figure(figure, base, **snakemake.params.options)
