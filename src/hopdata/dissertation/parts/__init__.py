"""Parts of the page: each measures the items that are told in ``items/<name>.toml``.

A part is a module with:

- ``make(seeds: Sequence[int]) -> Made``: measure; whatever is random is repeated with
  each of the seeds;
- ``draw(tables: Mapping[str, DataFrame]) -> Mapping[str, Figure]``: its figures by
  name, drawn by functions of ``hopdata.dissertation.figures`` from the tables as they
  are read again; a part without figures has no such function.

Each part is one job of the workflow, on one thread, in the folder of the bundled
configurations and recordings: ``config/config.yaml`` and ``data/sample/hopper.h5`` are
there wherever hopdata is installed. It runs again if the part, or a
module that it imports, changes. ``python -m hopdata.dissertation NAME`` makes one part
in ``results/dissertation/parts/NAME`` and prints its rows; a part that raises an error
stops no other.
"""
