"""The loop that all integrations share: step, localise, land, flip, go on."""
