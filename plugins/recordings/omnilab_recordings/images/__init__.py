"""Image files: which there are, how they are decoded, the circle in them, depth maps beside them."""
