"""Finds the modules that all benchmarks share, which stand in the folder above.

Import it before them: Python looks in a program's own folder alone.
"""

import sys
from pathlib import Path

sys.path.append(str(Path(__file__).parents[1]))
