"""Say what was found, and name what could not be made: the next run makes it again."""

import sys
from pathlib import Path

from hopdata.errors import AnalysisError
from hopdata.jobs import read_json, reported

with reported(snakemake.log[0], snakemake.input, snakemake.output):
    found = read_json(snakemake.input.found)
    print(f"hopdata: {snakemake.input.page}: {found['answer']}", file=sys.stderr)
    for fault in found["faults"]:
        print(f"hopdata: {fault['line']}", file=sys.stderr)
    faulty = {fault["part"] for fault in found["faults"]}
    for record in map(Path, snakemake.input.records):
        if record.parent.name in faulty:
            record.replace(record.with_name("failed.json"))
    if faulty:
        raise AnalysisError.at(
            str(snakemake.input.page),
            "all parts to be made",
            f"{len(faulty)} with a cause above; the same command makes them again",
        )
