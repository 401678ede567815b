"""What the surfaces of a world are painted with."""
