"""Contents and faults of a recording: pure functions on arrays of positions."""
