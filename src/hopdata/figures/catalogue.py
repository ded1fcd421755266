"""Every figure of the workflow: the function that draws it, and the files it is drawn from.

A figure is added by writing its function in one of this room's modules and its line here, under the
job that draws it; its caption stands in ``workflow/captions/<name>.md``.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any

# A date or a library version in a file would change its bytes without a change of the data.
#: Formats of figures, and what is written into a file beside the picture.
FORMATS: Mapping[str, Mapping[str, str | None]] = {
    "svg": {"Date": None, "Creator": "hopdata"},
    "png": {"Software": "hopdata"},
    "pdf": {"CreationDate": None, "Creator": "hopdata", "Producer": "hopdata"},
}


@dataclass(frozen=True)
class Drawing:
    """How a figure is made.

    Attributes
    ----------
    place
        Module and function, which takes tables and numbers in the order of `files`.
    files
        CSV and JSON files, by their paths below the folder of results.
    options
        Keyword arguments of the function.
    truth
        Further files, which only a simulated study has.
    """

    place: str
    files: tuple[str, ...]
    options: Mapping[str, Any] = field(default_factory=dict)
    truth: tuple[str, ...] = ()


def _table(*names: str) -> tuple[str, ...]:
    return tuple(f"tables/{name}.csv" for name in names)


def _beside(place: str, studies: tuple[str, str], names: tuple[str, ...]) -> Drawing:
    files = tuple(f"{study}/{name}" for study in studies for name in names)
    return Drawing(place, files, {"names": ("C1 hopper", "control, not C1")})


def _run(experiment: str) -> Drawing:
    options = {"experiment": experiment}
    return Drawing("steering:steering_run_figure", _table("examples"), options)


# The job that draws, and the figures that it draws. Files are found below the study's folder; for
# `steering_*` in its folder `steering`, for `sides` and `pair` in ``results``.
FIGURES: dict[str, dict[str, Drawing]] = {
    "landings": {
        "fig2_2_sections": Drawing(
            "sections:sections_figure",
            (*_table("section_frames", "section_densities"), "landings/sections.json"),
        ),
        "fig2_3_schedule": Drawing(
            "schedule:example_figure", _table("example_touchdown", "touchdowns")
        ),
        "stability": Drawing("quality:stability_figure", _table("section_stability", "drift")),
        "recording_gaps": Drawing(
            "quality:recording_gaps_figure", _table("markers", "gap_times", "faults")
        ),
    },
    "maps": {
        "verdict": Drawing(
            "verdict:verdict_figure",
            ("verdict.json", *_table("touchdowns")),
            truth=_table("verdict_errors"),
        ),
        "fig2_4_prediction": Drawing(
            "prediction:prediction_figure", (*_table("prediction_summary"), "tables/units.json")
        ),
        "fig2_5_distances": Drawing(
            "distances:distances_figure", _table("distances", "distance_summary")
        ),
        "map_matrices": Drawing(
            "maps:matrices_figure", _table("map_estimates"), truth=_table("exact_map")
        ),
    },
    "truth": {"scaling_study": Drawing("maps:scaling_study_figure", _table("scaling_study"))},
    "overlay": {
        "contact_overlay": Drawing(
            "overlay:contact_overlay_figure",
            _table("contact_overlay", "contact_overlay_summary", "contact_overlay_example"),
        )
    },
    "steering_model": {
        "steering_map": Drawing("models:frame_change_figure", _table("model_map", "training_hops")),
        "steering_learning": Drawing("models:learning_curve_figure", _table("learning_curve")),
        "steering_kernels": Drawing("models:kernel_smoothness_figure", _table("kernels")),
    },
    "steering_runs": {
        "fig3_5_origin": _run("origin"),
        "fig3_6_turn": _run("turn"),
        "fig3_8_origin_board": _run("origin_board"),
        "fig3_9_turn_board": _run("turn_board"),
        "steering_outcomes": Drawing(
            "steering:steering_outcomes_figure", _table("outcomes", "runs", "horizons")
        ),
    },
    "sides": {
        "fig2_5_both_sides": _beside(
            "distances:both_sides_figure",
            ("thesis", "control"),
            (*_table("distances", "distance_summary"), "verdict.json"),
        )
    },
    "pair": {
        "verdicts": _beside(
            "verdict:verdicts_figure",
            ("sample", "sample_control"),
            ("verdict.json", *_table("touchdowns")),
        )
    },
}


def tables_of(name: str, *, simulated: bool = False) -> tuple[str, ...]:
    """Return the files that a figure is drawn from, by their paths below the results."""
    drawing = _drawing(name)
    return drawing.files + (drawing.truth if simulated else ())


def source_of(name: str) -> Path:
    """Return the module that draws a figure."""
    return Path(__file__).with_name(f"{_drawing(name).place.partition(':')[0]}.py")


def function_of(name: str) -> Callable[..., Any]:
    """Return the function that draws a figure, with its options."""
    drawing = _drawing(name)
    module, _, function = drawing.place.partition(":")
    return partial(getattr(import_module(f"hopdata.figures.{module}"), function), **drawing.options)


def _drawing(name: str) -> Drawing:
    return next(drawings[name] for drawings in FIGURES.values() if name in drawings)
