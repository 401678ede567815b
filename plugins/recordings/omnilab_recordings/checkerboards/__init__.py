"""Calibration from pictures of a checkerboard: the commands calibrate and camera, and what they write."""
