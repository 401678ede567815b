"""Pose graphs by linear least squares: the error that `omnilab.posegraph.graph.residuals` measures, linearised, solved, repeated."""
