"""Small worlds for the tests of the mirror."""

from __future__ import annotations

import pytest
import trimesh

SMALL = """\
map_m: [2, 2]
texels_per_m: 32
light:
  ambient: 0.5
  lamps:
    - {at: [0.5, 0, 2.5], power: 1, reach_m: 2}
textures:
  boards: {kind: wood, color: [160, 110, 70]}
objects:
  - {kind: room, size: [4, 4, 3], floor: boards, ceiling: [220, 220, 220], north: boards}
  - {kind: box, name: crate, at: [0.8, 0.8], size: [0.4, 0.4, 1.5], texture: [200, 40, 40]}
  - kind: face
    corners: [[-1, 1, 0], [1, 1, 0], [1, 1, 1], [-1, 1, 1]]
    texture: [40, 40, 200]
"""


@pytest.fixture
def small() -> str:
    """The text of a world file."""
    return SMALL


@pytest.fixture
def write(tmp_path):
    """Writes a world file and returns its path as `Mirror.world` takes it."""

    def write(text: str, name: str = "world.yaml") -> str:
        (tmp_path / name).write_bytes(text if isinstance(text, bytes) else text.encode())
        return str(tmp_path / name)

    return write


@pytest.fixture
def save(tmp_path):
    """Writes a mesh of the given arguments of trimesh.Trimesh and returns its path."""

    def save(name: str, **arguments) -> str:
        trimesh.Trimesh(**arguments, process=False).export(tmp_path / name)
        return str(tmp_path / name)

    return save
