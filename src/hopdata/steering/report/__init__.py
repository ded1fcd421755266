"""The page of a steering study."""
