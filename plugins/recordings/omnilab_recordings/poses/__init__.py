"""Where images were taken: tables of positions, names, trajectories, grids."""
