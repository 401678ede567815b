"""From a world to images: the prepared world, rays, shading, shadows."""
