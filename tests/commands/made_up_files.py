"""QTM exports of the made-up hopper, for the commands."""

from made_up_hopper import MARKERS, hopping
from qtm_files import qtm_text, write

RATE_HZ = 100.0


def export(folder, positions=None, *, name="monday.tsv", scale=1000.0, **options):
    """Write a recording, by default a clean one, with `scale` units per metre."""
    positions = hopping(1)[1] if positions is None else positions
    text = qtm_text(scale * positions, names=options.pop("names", MARKERS), **options)
    text = "\n".join(
        "\t".join("" if field == "nan" else field for field in line.split("\t"))
        for line in text.split("\r\n")
    )
    return write(folder, text, name)
