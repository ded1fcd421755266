"""What a package of your own may bring; `pyproject.toml` names it all."""
