"""Figures: one module a figure, from tidy tables to matplotlib figures."""
