"""One door for what hopdata did not write itself: read apart, within limits."""
