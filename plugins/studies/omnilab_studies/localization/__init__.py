"""Localisation in a map: grids, steps of the grid, saved maps, changed rooms, large maps."""
