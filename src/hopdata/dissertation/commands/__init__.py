"""What the command line has of the dissertation: a target of ``hopdata run``."""
