"""Plain parts for studies: of descriptors, of maps, of trajectories."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest
from scipy.optimize import least_squares

from omnilab.api import (
    Circle,
    Embedding,
    Frames,
    GridPoses,
    Match,
    Optimized,
    PathPoses,
    Plan,
    RandomPoses,
    Signatures,
)
from omnilab.cameras import ImageCircle
from omnilab.errors import DataError
from omnilab.geometry import heading_of, planar_poses
from omnilab.posegraph.graph import chi2, edge_chi2, residuals

CAMERA = ImageCircle(16, 16, Circle(7.5, 7.5, 8))


@dataclass
class Floor:
    """A floor of 4 x 3 m whose image at (x, y), heading h, is painted in the grey levels of 60 x, 60 y and 40 h."""

    blocked: list[Any] = field(default_factory=list)  # [x, y] of nodes that are not free
    unread: list[int] = field(default_factory=list)  # frames that cannot be delivered
    asked: list[Any] = field(default_factory=list)  # the layouts, in order

    def plan(self, layout):
        self.asked.append(layout)
        if isinstance(layout, PathPoses):
            T = layout.T_world_camera
        elif isinstance(layout, RandomPoses):
            rng = np.random.default_rng(layout.seed)
            T = planar_poses(np.column_stack([rng.uniform(0, [4, 3], (layout.count, 2)), np.ones(layout.count)]))
        else:
            assert isinstance(layout, GridPoses)
            axes = [layout.step_m * np.arange(round(side / layout.step_m) + 1) for side in (4, 3)]
            x, y = (a.ravel() for a in np.meshgrid(*axes))
            free = [not any(np.allclose(node, spot) for spot in self.blocked) for node in zip(x, y, strict=True)]
            T = planar_poses(np.column_stack([x, y, np.ones(len(x))])[free])
        return Plan([str(i) for i in range(len(T))], T, [f"{spot}: inside 'box'" for spot in self.blocked])

    def frames(self, plan):
        for start in range(0, len(plan), 7):
            part = np.array([i for i in range(start, min(start + 7, len(plan))) if i not in self.unread], int)
            T = plan.T_world_camera[part]
            images = np.zeros((len(part), 16, 16), np.uint8)
            images[:, 5, 3:6] = np.round(np.column_stack([60 * T[:, :2, 3], 40 * np.mod(heading_of(T), 2 * np.pi)]))
            lost = [f"{i}: torn" for i in self.unread if start <= i < start + 7]
            yield Frames(images, [plan.keys[i] for i in part], part * 10, CAMERA, part, T, lost)

    def scene(self):
        return None


@dataclass
class Painted:
    """Reads the position back, four columns wide."""

    scale: float = 1.0
    view, color, rotation, default_distance = "mirror", False, "invariant", "apart"

    def describe(self, images):
        found = self.scale * images[:, 5, 3:5].astype(np.float32)
        return Signatures(np.concatenate([found, found[:, :1] * 0, found[:, :1] * 0], axis=1))


@dataclass
class Shifting(Painted):
    """The same, and says that turns shift it."""

    rotation = "equivariant"


@dataclass
class Blind(Painted):
    """Sees nothing."""

    def describe(self, images):
        return Signatures(np.zeros((len(images), 4), np.float32))


@dataclass
class Taught(Painted):
    """Describes only after it has seen the map."""

    def fit(self, images):
        assert len(images) > 1
        return Painted(self.scale)

    def restore(self, state):
        return Painted(float(state["scale"]))

    def describe(self, images):
        raise AssertionError("described before it was fitted")


@dataclass
class Apart:
    """The length of the difference, to some power."""

    power: float = 1.0

    def prepare(self, places):
        return places.place

    def match(self, queries, index):
        apart = np.linalg.norm(queries.place[:, None] - index[None], axis=-1)
        return Match((apart**self.power).astype(np.float32))


@dataclass
class Turning(Apart):
    """The same at the shift of the last axis that fits best."""

    def match(self, queries, index):
        shifted = [np.roll(queries.place, k, axis=-1) for k in range(queries.place.shape[-1])]
        return Match(np.min([super(Turning, self).match(Signatures(s), index).distance for s in shifted], axis=0))


@dataclass
class Picky(Apart):
    """Compares matrices alone."""

    def prepare(self, places):
        raise DataError("signatures of shape (4,) have no two axes")


@dataclass
class Scaling:
    """Classical scaling (Torgerson, 1952), and the states on the way from nothing to there."""

    asked: list[Any] = field(default_factory=list)  # how many maps were made at a time

    def prepare(self, places, distance):
        raise AssertionError("a study of maps asks for maps")

    def locate(self, queries, index):
        raise AssertionError("a study of maps asks for maps")

    def embed(self, distance, rng, steps=0):
        self.asked.append(len(distance))
        center = np.eye(distance.shape[1]) - 1 / distance.shape[1]
        value, axis = np.linalg.eigh(-0.5 * center @ distance**2 @ center)
        position = axis[..., -2:] * np.sqrt(np.maximum(value[:, None, -2:], 0))
        states = np.linspace(0, 1, steps)[:, None, None, None] * position if steps else None
        return Embedding(position, np.zeros(len(distance)), np.ones(len(distance), int), states)


@dataclass
class Shaken(Scaling):
    """The same, but every point is moved by what the start draws."""

    def embed(self, distance, rng, steps=0):
        made = super().embed(distance, rng, steps)
        return replace(made, position=made.position + 5 * rng.standard_normal((distance.shape[1], 2)))


@dataclass
class Least:
    """The least squares of scipy; online, each guess is believed."""

    def optimize(self, graph, covariances=False):
        roots = np.linalg.cholesky(graph.information)

        def off(x):
            poses = np.concatenate([graph.poses[:1], x.reshape(-1, 3)])
            return np.einsum("eji,ej->ei", roots, residuals(graph, poses)).ravel()

        found = least_squares(off, graph.poses[1:].ravel())
        poses = np.concatenate([graph.poses[:1], found.x.reshape(-1, 3)])
        weights = (edge_chi2(graph, poses) < 1e6).astype(float)
        return Optimized(poses, chi2(graph), chi2(graph, poses), found.nfev, weights)

    def begin(self, first_pose):
        return Chain([first_pose])


class Chain:
    def __init__(self, poses):
        self.all = poses

    def add(self, pose, edges, motions, information):
        assert edges.max() == len(self.all)
        assert np.linalg.eigvalsh(information).min() > 0
        self.all.append(pose)
        return []

    def pose(self, number):
        return self.all[number]

    def poses(self):
        return np.array(self.all)


@pytest.fixture(scope="session")
def plain():
    """The classes above, by name."""
    return {
        c.__name__: c
        for c in (Floor, Painted, Shifting, Blind, Taught, Apart, Turning, Picky, Scaling, Shaken, Least, Chain)
    }
