"""Whether the landings of a study are to be trusted: stability, drift, worst cases, checks."""
