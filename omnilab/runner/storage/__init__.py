"""Inputs on object storage and web servers: what a setting's URL names is fetched once, and components read the copy."""
