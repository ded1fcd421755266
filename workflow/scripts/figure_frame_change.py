"""Draw Figure 3.3 of the recommended model: frame changes over boom angle and swing."""

from pathlib import Path

from hopdata.figures.models import frame_change_figure
from hopdata.figures.style import save_figure
from hopdata.jobs import read_table, reported

with reported(snakemake.log[0]):
    maps, hops = (read_table(path).query("model == 'recommended'") for path in snakemake.input)
    figure = frame_change_figure(maps, hops)
    save_figure(figure, Path(snakemake.output[0]).with_suffix(""), **snakemake.params.options)
