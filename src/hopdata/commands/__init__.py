"""The commands of ``hopdata``, one module each: from parsed options to an exit code."""
