"""List the landings whose contacts are close together."""

import pandas as pd

from hopdata_own.close_landings import close_landings

touchdowns = pd.read_csv(snakemake.input.touchdowns)
found = close_landings(touchdowns, at_most_ms=snakemake.params.at_most_ms)
found.to_csv(snakemake.output.table, index=False)
