"""What descriptors and virtual cameras made, kept on disk by content: a sweep renders and describes each image once."""

from omnilab.runner.cache.disk_cache import DiskCache

__all__ = ["DiskCache"]
