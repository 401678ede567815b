"""Figures of the study `grid` alone."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

import numpy as np
import numpy.typing as npt

from omnilab.api import Bytes, Floats
from omnilab_studies.common.plots import COLORS, blank_figure

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def worst(
    queries: Sequence[Bytes], answered: Sequence[Bytes], error_m: Floats, verdict: npt.NDArray[np.str_]
) -> Figure:
    """The queries with the largest errors (top) and the places they were taken for (bottom)."""
    height, width = queries[0].shape[:2]
    figure = blank_figure(2.1 * len(error_m), 3.8 * height / width + 0.8)
    axes = figure.subplots(2, len(error_m), squeeze=False)
    for i, (query, answer) in enumerate(zip(queries, answered, strict=True)):
        for row, image in enumerate((query, answer)):
            axes[row, i].imshow(image, cmap="gray", vmin=0, vmax=255)
            axes[row, i].set(xticks=[], yticks=[])
        axes[0, i].set_title(f"{verdict[i]}, {error_m[i]:.2f} m", fontsize=9, color=COLORS[str(verdict[i])])
    axes[0, 0].set_ylabel("query")
    axes[1, 0].set_ylabel("answer")
    figure.suptitle("Largest errors")
    return figure
