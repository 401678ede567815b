"""The study `linearity`."""
