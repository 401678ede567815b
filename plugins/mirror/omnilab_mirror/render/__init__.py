"""Rendering of a world: baked light and shadows, atlases, rays, the tracer of quads, Embree and shading, free space."""
