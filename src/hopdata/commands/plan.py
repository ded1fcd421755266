"""``hopdata plan``: how many landings show which difference, from a pilot."""

import argparse
import json
from pathlib import Path
from typing import Any

from hopdata.commands.run import run_workflow
from hopdata.commands.terminal import OK
from hopdata.errors import ConfigError

DIFFERENCES = (0.03, 0.05, 0.1, 0.15, 0.2, 0.3, 0.5)


def plan(options: argparse.Namespace) -> int:
    """Print a table of differences and the landings that show them; draw the curve if asked."""
    from hopdata.maps.verdict.effect import landings_needed

    file = options.pilot
    if file.suffix in (".yaml", ".yml"):
        file = _verdict_of(file)
    landings, feet, power, seen = _pilot(file)
    found = f"{100 * seen:.2g} % in {100 * power:g} % of studies"
    print(f"{landings:,} landings of {feet} feet find {found}\n")
    print("difference  landings")
    own = () if options.difference is None else (options.difference,)
    needed = {
        difference: landings_needed(landings, seen, difference, feet)
        for difference in sorted({*DIFFERENCES, *own})
    }
    for difference, number in needed.items():
        print(f"{100 * difference:8.2g} %  {int(float(f'{number:.1e}')):8,}")
    if options.figure is not None:
        from hopdata.figures.style import save_figure
        from hopdata.figures.verdict import plan_figure

        figure = plan_figure(needed, (landings, seen), power)
        base, suffix = options.figure.with_suffix(""), options.figure.suffix.removeprefix(".")
        print(f"\n{save_figure(figure, base, formats=(suffix or 'svg',))[0]}: written")
    return OK


def _verdict_of(config: Path) -> Path:
    """Run a study, which may be simulated, as far as its verdict, and return where that is."""
    from hopdata.config.loading import load_config

    study = load_config(config)["study"]
    verdict = Path("results") / study / "verdict.json"
    print(f"{config}: as far as {verdict}", flush=True)
    if run_workflow(config, study, "--cores", "2", "--", str(verdict)):
        raise ConfigError(f"{config}: the study does not run to its verdict; see above")
    return verdict


def _pilot(file: Path) -> tuple[int, int, float, float]:
    """Return landings, feet, power and the difference that is found with it."""
    try:
        pilot: dict[str, Any] = json.loads(file.read_text(encoding="utf-8"))
        landings, feet, power = (pilot[key] for key in ("n_landings", "n_feet", "power"))
        effect = pilot["effect"]
    except OSError as error:
        raise ConfigError(f"{file}: {error.strerror}") from error
    except (ValueError, KeyError, TypeError) as error:
        raise ConfigError(
            f"{file}: expected the verdict.json of a study, found another file"
        ) from error
    if effect is None:
        raise ConfigError(f"{file}: the pilot has no answer: {pilot['sentence']}")
    return landings, feet, power, effect["detectable"]
