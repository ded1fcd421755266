"""The loop shared by all integrations: step, localise, land, flip, continue."""
