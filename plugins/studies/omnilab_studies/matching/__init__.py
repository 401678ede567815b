"""The study `matching`: how well odometries match images at given distances."""
