"""Set what all parts found in the order of the text."""

from pathlib import Path

from hopdata.dissertation.items import read_items
from hopdata.dissertation.making import read_record
from hopdata.dissertation.report.document import build_document
from hopdata.dissertation.report.entries import found_of
from hopdata.dissertation.report.page import build_page
from hopdata.jobs import reported, whole_file, write_json

with reported(snakemake.log[0], snakemake.input, snakemake.output):
    parts = [Path(file).parent for file in snakemake.input.records]
    folders = {part.name: part for part in parts}
    records = [read_record(part) for part in parts]
    items = read_items()
    write_json(snakemake.output.found, found_of(items, records))
    with whole_file(snakemake.output.document) as draft:
        draft.write_text(build_document(items, records), encoding="utf-8")
    with whole_file(snakemake.output.page) as draft:
        draft.write_text(build_page(items, records, folders), encoding="utf-8")
