"""Viewer layout of the study `views`."""

from __future__ import annotations

from omnilab.api import Panel, ViewLayout


def layout_of(panoramas: bool) -> ViewLayout:
    """Images from chosen poses, with or without their panoramas."""
    pictures = [Panel("image", "Picture", ("view/image",))]
    if panoramas:
        pictures.append(Panel("image", "Panorama", ("view/panorama",)))
    world = Panel("map", "World, poses and what the camera sees", ("room", "poses", "camera", "cloud"))
    return ViewLayout(columns=((world,), (*pictures, Panel("text", "Poses", ("summary",)))), widths=(3, 2))
