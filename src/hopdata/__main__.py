"""`python -m hopdata` is the command `hopdata`."""

import sys

from hopdata.cli import main

sys.exit(main())
