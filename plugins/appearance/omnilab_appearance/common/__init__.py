"""What several kinds of components share."""
