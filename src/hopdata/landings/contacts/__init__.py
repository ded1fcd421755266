"""Contact instants: where to look, the kink fit and its law, the printed method."""
