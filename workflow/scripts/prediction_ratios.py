"""Put the ratios of Fig. 2.4 of several studies side by side."""

import pandas as pd

from hopdata.jobs import read_table, reported, write_table
from hopdata.maps.prediction import error_ratios

with reported(snakemake.log[0]):
    files = zip(
        snakemake.params.names,
        snakemake.input.summaries,
        snakemake.input.touchdowns,
        strict=True,
    )
    rows = [
        {"study": name} | error_ratios(read_table(summary), read_table(touchdowns))
        for name, summary, touchdowns in files
    ]
    write_table(snakemake.output[0], pd.DataFrame(rows))
