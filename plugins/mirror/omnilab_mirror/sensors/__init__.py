"""Virtual cameras as sensors, by what they look through."""
