"""Figures from tidy tables; `catalogue` is the table of all of them."""
