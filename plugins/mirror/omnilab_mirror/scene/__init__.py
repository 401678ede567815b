"""Virtual worlds as data: files, objects, textures, meshes, light, free space."""
