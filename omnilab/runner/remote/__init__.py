"""Runs of a server, from the command line."""
