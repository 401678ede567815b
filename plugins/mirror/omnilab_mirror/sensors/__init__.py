"""Virtual cameras as sensors, by their optics: mirrors, lenses, panoramas."""
