"""Calibrations that other tools wrote: one module for each way of writing, and one that names what is not read."""
