"""Published data sets: where they are had, which files they hold, and their conversion to the documented folder."""
