"""View-based SLAM: maps of views, simulated and from images."""
