"""Experiments by their settings: recipes, forms, and what the builder says of overrides."""

from omnilab_serve.composing.checks import Composed, check_request

__all__ = ["Composed", "check_request"]
