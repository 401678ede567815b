"""The version of the contract, and what changed from one to the next.

A plugin may say for which it was written, `CONTRACT = "2.0"` in its module; one that says nothing is taken to be of
today's. The first number grows where something stops working as it did, the second where something is added.
"""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Change:
    """What a version of the contract changed, for whoever wrote a component of a kind for the one before."""

    version: str
    kind: str  # one of `KINDS`; "": all
    what: str  # in words that stand after a colon


CONTRACT_VERSION = "2.1"
CHANGES = (
    Change("2.0", "", "arrays that a component is given are read-only, so copy what is written into"),
    Change("2.0", "descriptor", "`turned` is called `rotation`, of 'equivariant', 'invariant' and 'none'"),
    Change("2.0", "localizer", "`follow` of one along a sequence is called `track`, `arrange` of one that embeds `embed`"),
    Change("2.0", "odometry", "`look` is called `extract`, `motion` is called `estimate`"),
    Change("2.0", "loop_closure", "`recall` of what it makes is called `query`"),
    Change("2.0", "backend", "`said` of what it returns is called `warnings`"),
    Change("2.0", "study", "`learnt` of places is called `descriptor_state`"),
    Change("2.1", "sensor", "one that renders has its images kept on disk where it is a `Renderer`, with `render` and `render_keys`"),
)  # fmt: skip
