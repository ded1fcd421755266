"""``hopdata plan``: how many landings show a difference, from a pilot."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from hopdata.analysis import fewest_note, plan_notes, planned, require_lasting
from hopdata.commands import answers
from hopdata.commands.terminal import OK, print_table
from hopdata.commands.values import require_number, values_of
from hopdata.commands.workflow import run_workflow
from hopdata.errors import ConfigError
from hopdata.foreign.texts import json_of
from hopdata.messages import Message


def plan(options: argparse.Namespace) -> int:
    """Print differences and the landings that show them; draw them on request."""
    from hopdata.maps.verdict.effect import landings_needed

    file = options.pilot
    if file.suffix in (".yaml", ".yml"):
        file = _verdict_of(file)
    _require_study(file)
    landings, feet, power, margin, effect = values_of(
        file, "verdict.json", "n_landings", "n_feet", "power", "margin", "effect"
    )
    if effect is None:
        sentence = values_of(file, "verdict.json", "sentence")[0]
        raise ConfigError(f"{file}: the pilot has no answer: {sentence}")
    if not isinstance(effect, dict) or not {"allowed", "detectable"} <= {*effect}:
        raise ConfigError.at(
            file, "a verdict of this version", "an older one; run the pilot again"
        )
    landings = int(require_number(file, "n_landings", landings))
    require_number(file, "n_feet", feet)
    require_number(file, "power", power)
    margin = require_number(file, "margin", margin)
    # Verdicts of older versions do not tell them.
    verdict = json_of(file, wanted="a verdict.json")
    saturates = bool(verdict.get("saturates", False))
    jump = verdict.get("jump") or {}
    jumps = jump.get("low", 0.0) > 0.0
    require_lasting(verdict.get("conclusion", ""), saturates=saturates, jumps=jumps)
    detectable, allowed, detectable_nearest, allowed_nearest = _sizes(file, effect)
    found = f"{100 * detectable:.3g} % in {100 * power:g} % of studies"
    print(f"{landings:,} judged landings of {feet} feet find {found}\n")
    if saturates:
        print(
            "These are differences over the landings. What may be hidden fades before"
        )
        print("the feet are far apart, and may be larger where all touch at once.\n")
    least = min(allowed, allowed_nearest)
    asked = {*planned(least, margin)}
    if options.difference is not None:
        asked.add(options.difference)
    needed = {
        difference: landings_needed(
            landings,
            detectable,
            allowed,
            difference,
            feet,
            detectable_nearest=detectable_nearest,
            allowed_nearest=allowed_nearest,
        )
        for difference in sorted(asked)
    }
    _print_needed(needed)
    size = effect.get("estimate", detectable)
    conclusion = verdict.get("conclusion", "")
    notes = plan_notes(conclusion, size, int(feet), jumps=jumps)
    fewest = fewest_note(needed.values(), int(feet), told=_as_in_table)
    rests_on = [str(note) for note in notes]
    if fewest is not None:
        print(f"\n{fewest}")
        rests_on.append(str(fewest))
    print(f"\n{Message('commands.plan_judged')}")
    for note in notes:
        print(f"\nnote: {note}")
    if margin <= least:
        of_margin = f"the margin, {100 * margin:g} %, is within the {100 * least:.2g} %"
        print(f"\n{of_margin} that smooth terms may leave: no number shows it")
    answers.give(
        pilot={
            "file": file,
            "landings": landings,
            "feet": feet,
            "power": power,
            "detectable": detectable,
        },
        plan=[
            {"difference": difference, "landings": number}
            for difference, number in needed.items()
        ],
        notes=rests_on,
        figure=options.figure,
    )
    if options.figure is not None:
        _draw(options.figure, needed, (landings, detectable), power)
    return OK


def _require_study(file: Path) -> None:
    """Raise an error that says how to plan a group, if the file is a group's.

    Raises
    ------
    ConfigError
    """
    content = json_of(file, wanted="the verdict.json of a study")
    if isinstance(content, dict) and "members" in content and "n_feet" not in content:
        raise ConfigError(str(Message("commands.plan_of_group", {"file": file})))


def _sizes(file: Path, effect: Mapping[str, Any]) -> list[float]:
    """Return what is detectable and what smooth terms may account for, in two windows.

    Verdicts of older versions tell of one window only.
    """
    sizes = []
    for key in ("detectable", "allowed", "detectable_nearest", "allowed_nearest"):
        value = effect.get(key, effect[key.removesuffix("_nearest")])
        sizes.append(float(require_number(file, f"effect.{key}", value)))
    return sizes


def _print_needed(needed: Mapping[float, int]) -> None:
    """Print the table of differences and landings, these to two digits."""
    rows = [
        (f"{100 * difference:.2g} %", _as_in_table(number))
        for difference, number in needed.items()
    ]
    lines = [f"{difference:>10}  {landings:>8}" for difference, landings in rows]
    print_table(
        {"difference": "right", "landings": "right"},
        rows,
        plain="\n".join(["difference  landings", *lines]),
    )


def _as_in_table(landings: int) -> str:
    """Return a number of landings to two digits."""
    from hopdata.maps.verdict.words import two_digits

    return f"{two_digits(landings):,}"


def _draw(
    file: Path, needed: Mapping[float, int], pilot: tuple[int, float], power: float
) -> None:
    from hopdata.figures.style import save_figure
    from hopdata.figures.verdict import plan_figure

    figure = plan_figure(needed, pilot, power)
    ending = file.suffix.removeprefix(".") or "svg"
    written = save_figure(figure, file.with_suffix(""), formats=(ending,))
    print(f"\n{written[0]}: written")


def _verdict_of(config: Path) -> Path:
    """Run a study, which may be simulated, up to its verdict, and return that file."""
    from hopdata.config.loading import load_config

    study = load_config(config)["study"]
    verdict = Path("results") / study / "verdict.json"
    print(f"{config}: as far as {verdict}", flush=True)
    if run_workflow(config, study, "--cores", "2", "--", str(verdict)):
        raise ConfigError(f"{config}: the study does not run to its verdict; see above")
    return verdict
