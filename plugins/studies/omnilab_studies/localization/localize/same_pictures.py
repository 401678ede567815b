"""Whether the pictures of queries are like those of the map: taken by the same camera, in the same colours and world."""

from __future__ import annotations

import logging
from collections.abc import Iterator
from dataclasses import dataclass

from omnilab.api import Frames, Mesh, Places, Plan, PoseRequest, Provenance, Sensor
from omnilab.errors import DataError
from omnilab_studies.common.describing import provenance_of

ALIKE_DEG = 2.0  # elevations at the edges of panoramas: two calibrations of one camera differ by less
SETTING = "study.other_pictures"

log = logging.getLogger("omnilab")


@dataclass
class ComparedSensor:
    """The sensor of the queries: its first pictures are compared with the map's before any is localised.

    DataError where signatures cannot mean the same, unless `allowed`; what else differs, is allowed or is not known is a
    warning.
    """

    sensor: Sensor
    places: Places  # the map
    color: bool  # whether the descriptor sees colours
    allowed: bool
    compared: bool = False

    def plan(self, layout: PoseRequest) -> Plan:
        return self.sensor.plan(layout)

    def frames(self, plan: Plan) -> Iterator[Frames]:
        for frames in self.sensor.frames(plan):
            if not self.compared:
                self._compare(provenance_of(frames, self.sensor))
                self.compared = True
            yield frames

    def scene(self) -> Mesh | None:
        return self.sensor.scene()

    @property
    def live(self) -> bool:
        """Whether frames come when they are taken, and wait for nobody."""
        return bool(getattr(self.sensor, "live", False))

    def _compare(self, queries: Provenance) -> None:
        known = self.places.provenance
        if known is None:
            log.warning(
                "the map does not say by which camera and of which world its pictures are (it is of an earlier omnilab):"
                " whether the queries are like them cannot be told; make it anew to know"
            )
            return
        wrong, notes = differences(known, queries, self.color)
        if wrong and not self.allowed:
            raise DataError(
                f"{wrong[0]}, and what is described of one means nothing to the other; choose the sensor that made the map,"
                f" or give {SETTING}=true if that is meant"
            )
        for sentence in [*wrong, *notes]:
            log.warning("%s", sentence)


def differences(places: Provenance, queries: Provenance, color: bool) -> tuple[list[str], list[str]]:
    """In what the pictures of a map and those of its queries differ: what forbids to compare them, and what does not."""
    wrong, notes = [], []
    if places.camera != queries.camera:
        wrong.append(f"the map was made by {_a(places.camera)}, these queries by {_a(queries.camera)}")
    elif places.elevations_deg and queries.elevations_deg:
        pairs = zip(places.elevations_deg, queries.elevations_deg, strict=True)
        if any(abs(one - other) > ALIKE_DEG for one, other in pairs):
            wrong.append(
                f"the map's {places.camera} shows elevations from {_range(places.elevations_deg)} degrees, that of these"
                f" queries from {_range(queries.elevations_deg)}"
            )
    if color and places.color != queries.color:
        wrong.append(f"the map was made of {_colors(places)} pictures, these queries are {_colors(queries)}")
    if places.world and queries.world and places.world_digest != queries.world_digest:
        if places.world != queries.world:
            wrong.append(f"the map is of the world '{places.world}', these queries of '{queries.world}'")
        else:
            notes.append(f"the map is of another variant or state of the world '{places.world}' than these queries")
    if (places.width, places.height) != (queries.width, queries.height):
        notes.append(
            f"the map's pictures have {places.width} x {places.height} pixels, those of these queries"
            f" {queries.width} x {queries.height}"
        )
    return wrong, notes


def _a(camera: str) -> str:
    return f"{'an' if camera[0] in 'AEIOU' and not camera.startswith('Uni') else 'a'} {camera}"


def _range(elevations_deg: tuple[float, float]) -> str:
    return f"{elevations_deg[0]:.0f} to {elevations_deg[1]:.0f}"


def _colors(pictures: Provenance) -> str:
    return "coloured" if pictures.color else "grey"
