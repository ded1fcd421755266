"""The two Poincare sections: ground modes, the frames that count, the heights."""
