"""Models of the frame change of a hop as a function of boom angle and swing."""
