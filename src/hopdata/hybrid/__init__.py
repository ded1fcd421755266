"""Event-selected hybrid systems: stepping, event localisation and mode bookkeeping."""
