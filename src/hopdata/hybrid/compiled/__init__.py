"""Compilation of Python functions to machine code: views, callbacks, cache."""
