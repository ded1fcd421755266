"""Files of settings in the working folder, which libraries would read: left unread.

Matplotlib reads a file ``matplotlibrc`` of the working folder when it is imported, and
Numba a file ``.numba_config.yaml``, also whenever it compiles. In a study's folder
anybody may have put them there: they would change what is drawn or compiled, or, as a
pipe, keep every command waiting. Settings of the user (``~/.config/matplotlib``,
``MATPLOTLIBRC``, ``NUMBA_...``) still count.
"""

from __future__ import annotations

import os
import sys
from importlib import import_module
from pathlib import Path

#: Which library reads which file of the working folder.
READ = {"matplotlibrc": "matplotlib", ".numba_config.yaml": "numba"}


def leave_unread() -> None:
    """Import libraries whose settings lie in the working folder from another folder.

    Nothing is imported where there is no such file, which is nearly always. It is
    called before other threads begin, since the working folder is that of all threads.
    """
    for file, library in READ.items():
        if library in sys.modules or not os.path.lexists(file):
            continue
        here = os.getcwd()
        os.chdir(Path(__file__).parent)
        try:
            import_module(library)
        except ImportError:  # it is missing, and will be told by who needs it
            continue
        finally:
            os.chdir(here)
        if library == "numba":
            import_module("hopdata.private_numba").read_no_settings()
