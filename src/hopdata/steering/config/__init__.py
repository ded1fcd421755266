"""The block ``steering`` of the configuration: its schema, and what fits together."""
