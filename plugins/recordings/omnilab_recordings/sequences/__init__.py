"""Folders of images as published sets of sequences lay them out: TUM, EuRoC, KITTI-360."""
