"""Videos: containers opened within bounds, an index of their frames, frame-exact decoding, pixels."""
