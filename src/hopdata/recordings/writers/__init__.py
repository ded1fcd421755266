"""Writers of contact events, one module for each format."""
