"""The study `parameter_curves`."""
