"""The block ``steering`` of the configuration: its schema, and whether its keys fit together."""
