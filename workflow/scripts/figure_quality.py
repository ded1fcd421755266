"""Draw the three figures of the quality of a study."""

from pathlib import Path

from hopdata.figures.quality import recording_gaps_figure
from hopdata.figures.style import save_figure
from hopdata.figures.quality import stability_figure
from hopdata.figures.quality import worst_landings_figure
from hopdata.jobs import read_table, reported

with reported(snakemake.log[0]):
    tables = {
        name: read_table(getattr(snakemake.input, name))
        for name in ("markers", "gaps", "faults", "stability", "drift", "landings", "samples")
    }
    figures = {
        "stability": stability_figure(tables["stability"], tables["drift"]),
        "worst_landings": worst_landings_figure(tables["landings"], tables["samples"]),
        "recording_gaps": recording_gaps_figure(
            *(tables[n] for n in ("markers", "gaps", "faults"))
        ),
    }
    for name, figure in figures.items():
        first = Path(getattr(snakemake.output, name)[0])
        save_figure(figure, first.with_suffix(""), **snakemake.params.options)
