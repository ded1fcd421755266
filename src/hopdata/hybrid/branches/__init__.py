"""Where a guard's code takes another branch, found by ranges of values."""
