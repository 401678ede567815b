"""The web viewer of the installed rerun-sdk, from our own origin, and the recordings that it is given."""

from omnilab_serve.viewer.recording import follow
from omnilab_serve.viewer.web_viewer import WebViewer

__all__ = ["WebViewer", "follow"]
