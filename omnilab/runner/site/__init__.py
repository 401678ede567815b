"""The documentation site: pages made of docstrings, recipes and settings, beside those that are written (docs/)."""
