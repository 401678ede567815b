"""Virtual worlds as data: files, objects, textures, meshes, light. Nothing here imports `render`."""
