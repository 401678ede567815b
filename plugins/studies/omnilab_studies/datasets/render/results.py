"""Results of the study `render`: what was written into a data set, and a sheet of examples."""

from __future__ import annotations

from omnilab.api import Metric, Plan, Report
from omnilab_studies.common.dataset_files import DataSet
from omnilab_studies.common.samples import evenly
from omnilab_studies.common.tables import markdown_table
from omnilab_studies.datasets.render import figures
from omnilab_studies.datasets.render.dataset_writer import RenderedFrames


def report_of(data: DataSet, rendered: RenderedFrames, plan: Plan, cloud_points: int | None) -> Report:
    """Metrics, and a sheet of images, of a data set that is on disk; `cloud_points` is None where there is no cloud."""
    numbers = rendered.numbers
    omitted = [*plan.omitted, *rendered.omitted]
    metrics = [
        Metric("images", len(numbers), "1"),
        Metric("left_out", len(omitted), "1"),
        Metric("bytes_per_image", sum(data.image(n).stat().st_size for n in numbers.tolist()) / len(numbers), "B"),
    ]
    if cloud_points is not None:
        metrics.append(Metric("cloud_points", cloud_points, "1"))
    chosen = numbers[evenly(len(numbers), figures.SHEET)]
    poses = plan.T_world_camera
    sheet = figures.sheet(
        [data.read(n) for n in chosen.tolist()],
        chosen,
        None if poses is None else poses[numbers],
        None if poses is None else poses[chosen],
    )
    return Report(
        metrics, figures={"images": sheet}, summary=markdown_table(metrics, str(data.folder)), omitted=omitted
    )
