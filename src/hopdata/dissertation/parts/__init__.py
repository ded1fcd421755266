"""Parts of the page: each measures the items that are told in ``items/<name>.toml``.

A part is a module with:

- ``make(seeds: Sequence[int]) -> Made``: measure; whatever is random is repeated with
  each of the seeds;
- ``draw(tables: Mapping[str, DataFrame]) -> Mapping[str, Figure]``: its figures by name,
  drawn by functions of ``hopdata.dissertation.figures``; a part without figures has none.

Each part is one job of the workflow.
"""
