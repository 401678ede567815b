"""One run split over the jobs of a sweep: a share of a stage each, and one that merges them."""
