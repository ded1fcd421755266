"""Body states at the two sections, and their pairs in the home frame."""
