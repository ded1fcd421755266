"""``hopdata config-docs``: the page on the configuration's keys."""

from __future__ import annotations

import argparse

from hopdata.commands.exit_codes import OK
from hopdata.commands.writing import write_text


def config_docs(options: argparse.Namespace) -> int:
    """Write the page on the configuration's keys."""
    from hopdata.config.documentation import configuration_page

    page = configuration_page()
    if options.out is None:
        print(page, end="")
    else:
        write_text(options.out, page)
    return OK
