"""Code that several kinds of components share."""
