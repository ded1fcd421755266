"""The two Poincare sections: ground modes, the frames used, and the heights."""
