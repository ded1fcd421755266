"""Draw figures of one kind, as `hopdata.figures.catalogue` lists them."""

from pathlib import Path

from hopdata.figures.style import draw
from hopdata.jobs import reported

with reported(snakemake.log[0], snakemake.input, snakemake.output):
    for name in snakemake.params.names:
        output = next(path for path in snakemake.output if Path(path).stem == name)
        files = list(snakemake.input.get(name))
        draw(name, files, Path(output).with_suffix(""), **snakemake.params.options)
