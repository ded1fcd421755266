"""``hopdata plan``: how many landings show which difference, from a pilot."""

from __future__ import annotations

import argparse
import json

from hopdata.commands.terminal import OK
from hopdata.errors import ConfigError

DIFFERENCES = (0.03, 0.05, 0.1, 0.15, 0.2, 0.3, 0.5)


def plan(options: argparse.Namespace) -> int:
    """Print a table of differences and the landings that show them."""
    from hopdata.maps.verdict.effect import landings_needed

    try:
        pilot = json.loads(options.verdict.read_text(encoding="utf-8"))
        landings, feet, power = (pilot[key] for key in ("n_landings", "n_feet", "power"))
        effect = pilot["effect"]
    except OSError as error:
        raise ConfigError(f"{options.verdict}: {error.strerror}") from error
    except (ValueError, KeyError, TypeError) as error:
        raise ConfigError(
            f"{options.verdict}: expected the verdict.json of a study, found another file"
        ) from error
    if effect is None:
        raise ConfigError(f"{options.verdict}: the pilot has no answer: {pilot['sentence']}")
    seen = effect["detectable"]
    found = f"{100 * seen:.2g} % in {100 * power:g} % of studies"
    print(f"{landings:,} landings of {feet} feet find {found}\n")
    print("difference  landings")
    own = () if options.difference is None else (options.difference,)
    for difference in sorted({*DIFFERENCES, *own}):
        needed = landings_needed(landings, seen, difference, feet)
        print(f"{100 * difference:8.2g} %  {int(float(f'{needed:.1e}')):8,}")
    return OK
