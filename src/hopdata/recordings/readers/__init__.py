"""Readers, one module per format, from a path to a `RawRecording`; see `formats`."""
