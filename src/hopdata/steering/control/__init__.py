"""Control: which swings bring the hopper to a point, or turn it to a heading."""
