"""Parts and items that tests make up, and a checkout that has no others."""

import shutil
import sys
from pathlib import Path
from types import ModuleType

ROOT = Path(__file__).parents[2]
PLACE = Path("src/hopdata/dissertation")

# A part with a figure, two claims and a definition.
SOUND = '''
"""A part that works."""
import pandas as pd
from hopdata.dissertation.rows import Agreement, Made, Row, over_seeds
from hopdata.figures import style


def make(seeds):
    slopes = over_seeds(lambda seed: 4.0 + seed % 2, seeds)
    rows = [
        Row(93, Agreement.DIFFERS, {"slope": slopes, "printed": 4.2}, "all_points"),
        Row(1, Agreement.BUILT, {"error": 3e-16}),
        Row(32, Agreement.AGREES, {"maps": 36}),
    ]
    table = pd.DataFrame({"step": [1.0, 2.0], "error": [1.0, 16.0]})
    return Made(rows, {"order": table})


def draw(tables):
    figure = style.paper_figure(style.SINGLE_COLUMN_MM, 50)
    figure.subplots().plot(tables["order"]["step"], tables["order"]["error"])
    return {"fig4_2_order": figure}
'''
SOUND_ITEMS = """
seconds = 20

[[item]]
number = 93
section = "4.4.2"
title = "Order of the method"
printed = "slope 4.2"
printed_method = "slope {printed:.2f}"
ours = "slope {slope:.1f}"
where = "hopdata.hybrid"
figure = "fig4_2_order"
figure_printed = "error over step, both logarithmic"
figure_read = "Steeper is better."
reasons = {all_points = "the printed fit takes 4 of 37 points; all give {slope:.0f}"}

[[item]]
number = 1
section = "1.2"
title = "Event function"
printed = "Definition 1.2.1"
printed_method = "error {error:.0e}"
where = "hopdata.hybrid.first_order"

[[item]]
number = 32
section = "2.2.4"
title = "Affine maps"
printed = "affine | least squares"
ours = "{maps} maps"
where = "hopdata.maps.affine"
"""


def item(number, **fields):
    """Return the entry of an item in a file of items."""
    lines = [f"[[item]]\nnumber = {number}"]
    entry = {
        "section": "4.5",
        "title": f"Item {number}",
        "printed": f"statement {number}",
        "where": "hopdata",
        **fields,
    }
    lines += [f'{name} = "{text}"' for name, text in entry.items()]
    return "\n".join(lines) + "\n\n"


def install(monkeypatch, name, text):
    """Put a part among the modules as if it stood in the folder of the parts."""
    module = ModuleType(f"hopdata.dissertation.parts.{name}")
    exec(text, vars(module))
    monkeypatch.setitem(sys.modules, module.__name__, module)


def write_part(checkout, name, text, items):
    """Write a part and its items into a checkout."""
    place = checkout / PLACE
    (place / "parts" / f"{name}.py").write_text(text)
    (place / "items" / f"{name}.toml").write_text(items)


def without_parts(checkout):
    """Replace the linked library of a checkout by a copy that has no parts."""
    (checkout / "src").unlink()
    ignored = shutil.ignore_patterns("__pycache__")
    shutil.copytree(ROOT / "src", checkout / "src", symlinks=True, ignore=ignored)
    for file in (checkout / PLACE / "parts").glob("[!_]*.py"):
        file.unlink()
    for file in (checkout / PLACE / "items").glob("*.toml"):
        file.unlink()
