"""Put the advice that a study's page gives into docs/cannot_tell.md.

    python packaging/cannot_tell.py            writes it in a checkout (`make docs`)

The advice is said once, in the report's ``messages.toml`` (``advice_*``). The page has
it between ``<!-- advice: NAME -->`` and ``<!-- end -->``. A test compares the page with
what would be written now.
"""

import re
import textwrap
import tomllib
from pathlib import Path

CHECKOUT = Path(__file__).parents[1]
PAGE = CHECKOUT / "docs" / "cannot_tell.md"
MESSAGES = CHECKOUT / "src" / "hopdata" / "report" / "messages.toml"
PLACE = re.compile(r"(<!-- advice: (\w+) -->\n).*?(<!-- end -->)", re.DOTALL)
# Characters in a line of the page.
WIDTH = 120


def advice() -> dict[str, str]:
    """Return the advice on each limit by its name."""
    messages = tomllib.loads(MESSAGES.read_text("utf-8"))
    return {
        name.removeprefix("advice_"): text
        for name, text in messages.items()
        if name.startswith("advice_")
    }


def written(page: str) -> str:
    """Return the page with the advice as it is given now."""
    known = advice()

    def filled(place: re.Match[str]) -> str:
        begin, name, end = place.groups()
        text = textwrap.fill(
            known[name], WIDTH, break_long_words=False, break_on_hyphens=False
        )
        return f"{begin}{text}\n{end}"

    return PLACE.sub(filled, page)


if __name__ == "__main__":
    PAGE.write_text(written(PAGE.read_text("utf-8")), encoding="utf-8")
