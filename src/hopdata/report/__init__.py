"""One self-contained page with the figures, tables and provenance of a study."""
