"""Experiments by their settings: recipes, forms, and what the builder says of overrides, from a process of its own."""

from omnilab_serve.composing.checks import Composed, check_request
from omnilab_serve.composing.composer import Composer, ComposerError, SettingError

__all__ = ["Composed", "Composer", "ComposerError", "SettingError", "check_request"]
