"""Put the ratios of Fig. 2.4 of several studies side by side."""

import pandas as pd

from hopdata.jobs import read_table, reported, write_table
from hopdata.maps.prediction import error_ratios

with reported(snakemake.log[0], snakemake.input, snakemake.output):
    rows = []
    for number, name in enumerate(snakemake.params.names):
        summary = read_table(snakemake.input.summaries[number])
        touchdowns = read_table(snakemake.input.touchdowns[number])
        rows.append({"study": name, **error_ratios(summary, touchdowns)})
    write_table(snakemake.output[0], pd.DataFrame(rows))
