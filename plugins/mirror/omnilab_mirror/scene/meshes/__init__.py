"""Meshes from OBJ, GLB and PLY files."""
