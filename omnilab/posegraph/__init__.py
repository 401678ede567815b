"""Pose graphs: motions composed, errors of edges, checks of soundness; g2o and TORO files."""
