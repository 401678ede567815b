"""A component of each kind, small and working, to be changed into another."""
