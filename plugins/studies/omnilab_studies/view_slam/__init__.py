"""View-based SLAM (Gil et al., 2012): maps of views, on simulated drives and from images."""
