"""Control: the swings that bring the hopper to a point, or turn it to a heading."""
