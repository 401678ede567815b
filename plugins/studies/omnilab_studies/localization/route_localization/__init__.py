"""Study `route_localization`."""
