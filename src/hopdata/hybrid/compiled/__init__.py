"""How Python functions become machine code: views, callbacks, cache."""
