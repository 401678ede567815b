"""Loop closures."""
