"""States at the sections, and the pairs of them in the home frame."""
