"""Descriptors and distances on a GPU, by torch: the components' own classes, with the array work done there."""
