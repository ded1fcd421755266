"""Kinds of number for which a user's function of plain numbers compiles unchanged."""
