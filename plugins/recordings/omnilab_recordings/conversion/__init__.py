"""Recordings into the documented folder of images, and into MCAP."""
