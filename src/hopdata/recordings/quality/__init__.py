"""What is in a recording, and what is wrong with it: pure functions on arrays of positions."""
