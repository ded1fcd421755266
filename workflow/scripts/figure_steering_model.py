"""Draw Fig. 3.3, the learning curve and the comparison of kernels."""

from pathlib import Path

from hopdata.figures.models import frame_change_figure
from hopdata.figures.kernel_smoothness import kernel_smoothness_figure
from hopdata.figures.models import learning_curve_figure
from hopdata.figures.style import save_figure
from hopdata.jobs import read_table, reported

with reported(snakemake.log[0]):
    table = {name: read_table(path) for name, path in snakemake.input.items()}
    figures = {
        "steering_map": frame_change_figure(table["map"], table["training"]),
        "steering_learning": learning_curve_figure(table["curve"]),
        "steering_kernels": kernel_smoothness_figure(table["kernels"]),
    }
    for name, figure in figures.items():
        base = Path(snakemake.output[0]).with_name(name)
        save_figure(figure, base, **snakemake.params.options)
