"""Figures drawn from tidy tables; `catalogue` lists them all."""
