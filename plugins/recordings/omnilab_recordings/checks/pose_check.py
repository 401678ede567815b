"""Check of what the poses of a folder mean: the questions of a run, and how headings go with pictures and path."""

from __future__ import annotations

from collections.abc import Iterator

from omnilab.trajectory import plausibility
from omnilab_recordings.checks.dataset_check import Finding
from omnilab_recordings.folder import Folder
from omnilab_recordings.questions import questions, seen_turns, trajectory_of

AHEAD_DEG = 20.0  # from the heading to the direction of travel, of a robot that drives ahead


def of_meaning(sensor: Folder) -> Iterator[Finding]:
    """What the poses may have been meant to be instead; whether pictures and path turn as the headings do."""
    if sensor.recording.positions is None:
        return
    path, turns = trajectory_of(sensor.recording.positions), seen_turns(sensor)
    open_questions = questions(sensor)
    yield from (Finding("meaning", "look", question) for question in open_questions)
    if turns.agree:
        agreement = f"{turns.as_read:.2f}; 1 is full agreement"
        yield Finding("headings", "ok", f"{turns.pairs} pairs of neighbours turn as their pictures do ({agreement})")
    elif not open_questions and turns.unit_left and plausibility.look_like_radians(path):
        yield Finding("headings", "?", f"cannot tell: {plausibility.unit_remedy(path)}")
    travel = plausibility.with_travel(path)
    if travel is None or travel.agreement < plausibility.AGREE:
        return
    if abs(travel.offset_deg) < AHEAD_DEG:
        yield Finding("travel", "ok", "the path leads where the headings point")
    else:
        side = "left" if travel.offset_deg > 0 else "right"
        where = f"the path leads {abs(travel.offset_deg):.0f} degrees to the {side} of the headings"
        yield Finding(
            "travel",
            "?",
            f"{where}: right if the camera, or what the headings speak of, points there; else they count from elsewhere than +x",
        )
