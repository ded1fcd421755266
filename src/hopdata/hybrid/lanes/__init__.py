"""Many systems side by side, one per lane of the processor's vectors."""
