"""Maps of one drive that differ in how images are related, and in when one becomes a view."""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from omnilab.api import Floats, ViewFilter
from omnilab.trajectory.evaluation import rms
from omnilab_studies.view_slam.consistency import errors, nees, nees_bounds
from omnilab_studies.view_slam.filter_runs import position_rms
from omnilab_studies.view_slam.front_end import AssociationSettings, ViewAssociation, ViewMapper
from omnilab_studies.view_slam.initialisation import Initialisation
from omnilab_studies.view_slam.view_density.relations import Relations


class Case(NamedTuple):
    """A filter, a way of relating images, and when one becomes a view."""

    filter: str
    method: str
    rule: Initialisation
    threshold: float  # of R, or in nats

    @property
    def label(self) -> str:
        """The method; of views chosen by information with that."""
        return self.method if self.rule is Initialisation.similarity else f"{self.method}_information"

    def settings(self, common: AssociationSettings) -> AssociationSettings:
        """Those of association, with this case's rule."""
        if self.rule is Initialisation.similarity:
            return replace(common, initialisation=self.rule, similarity=self.threshold)
        return replace(common, initialisation=self.rule, least_gain=self.threshold)


class MappedDrive:
    """One case with the wheels of one seed: a map that grows, image by image."""

    def __init__(self, case: Case, view_filter: ViewFilter, common: AssociationSettings, relations: Relations) -> None:
        self.case = case
        self.associations: list[ViewAssociation] = []
        self._view_filter, self._settings, self._relations = view_filter, case.settings(common), relations
        self._requested, self._filter_s = 0, 0.0

    def begin(self, start: Floats) -> None:
        """A map without views, at a pose (3,)."""
        self.mapper = ViewMapper(self._view_filter, self._settings, self._relate, start)

    def _relate(self, image: int, view: int) -> Any:
        self._requested += 1
        start = time.thread_time()
        motion = self._relations.relate(image, view)
        self._filter_s -= time.thread_time() - start  # which the step's time contains
        return motion

    def process(self, image: int, motion: tuple[Floats, Floats] | tuple[None, None]) -> ViewAssociation:
        """One more image, after a motion (3,) with its covariance (3, 3)."""
        start = time.thread_time()
        self.associations.append(self.mapper.process(image, self._relations.features[image], *motion))
        self._filter_s += time.thread_time() - start
        return self.associations[-1]

    def row(self, truth: Floats, odometry: Floats) -> dict[str, float]:
        """Numbers of the drive, by its true poses (T, 3) and those of odometry."""
        poses, covariances = (np.array(each) for each in zip(*self.mapper.poses, strict=True))
        error, (low, high) = errors(poses, truth), nees_bounds(1)
        own = nees(error[1:], covariances[1:])
        observed = sum(len(each.views) for each in self.associations)
        relate_ms = 1e3 * float(np.mean(self._relations.relate_s or [0.0])) * self._requested / len(truth)
        return {
            "views": len(self.mapper.images), "rms_m": position_rms(poses, truth),
            "heading_rms_deg": float(np.rad2deg(rms(error[:, 2]))), "nees": float(own.mean()),
            "nees_within": float(((low <= own) & (own <= high)).mean()), "observed": observed,
            "gated": 1 - sum(int(each.believed.sum()) for each in self.associations) / max(1, observed),
            "odometry_rms_m": position_rms(odometry, truth), "related": self._requested / len(truth),
            "image_ms": 1e3 * float(np.mean(self._relations.extract_s)) + relate_ms + 1e3 * self._filter_s / len(truth),
        }  # fmt: skip


def mean_row(case: Case, rows: Sequence[dict[str, float]]) -> dict[str, Any]:
    """The mean of a case's drives, with the standard deviations of the views and the error."""
    means = {key: float(np.mean([row[key] for row in rows])) for key in rows[0]}
    spread = {f"{key}_sigma": float(np.std([row[key] for row in rows], ddof=1)) for key in ("views", "rms_m")}
    return {**columns(case), "drives": len(rows), **means, **spread}


def columns(case: Case) -> dict[str, Any]:
    """A case, as the first columns of a table."""
    return {
        "filter": case.filter, "label": case.label, "method": case.method, "rule": case.rule.value,
        "threshold": case.threshold,
    }  # fmt: skip
