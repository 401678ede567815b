"""HOG and gist in grids of normalised cells, which bear noise, occlusion, blur and light."""
