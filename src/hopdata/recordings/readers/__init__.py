"""One module a format, from a path to a `RawRecording`; `formats` chooses by suffix."""
