"""Study `catchment`."""
