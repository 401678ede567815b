"""Heights of the camera from images."""
