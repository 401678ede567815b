"""A robot's trajectory and map from images: odometry, loop closure, pose graph."""
