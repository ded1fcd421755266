"""Drawings of the parts' tables; nothing is computed here."""
