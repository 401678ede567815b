"""A study in shards on a cluster, on paper and as events: how long it takes, and what passes over the disk that all share.

python tests/shards/cluster_simulation.py    # the table of docs/clusters.md
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np


@dataclass(frozen=True)
class Study:
    """A map and queries; seconds are of one worker's processor."""

    places: int
    queries: int
    place_s: float  # render and describe
    query_s: float  # render, describe and compare with the whole map
    prepare_s: float  # of the map, once a worker
    merge_s: float  # metrics, intervals, figures
    place_bytes: int
    query_bytes: int = 400  # of what is kept of a query

    @property
    def alone_s(self) -> float:
        """By one worker without shards."""
        return self.places * self.place_s + self.prepare_s + self.queries * self.query_s + self.merge_s


@dataclass(frozen=True)
class Cluster:
    """Nodes with workers, one shard each, before one disk."""

    nodes: int
    workers: int = 16  # of a node, which reads a file once for all of them
    start_s: float = 3.0  # from a launch to a worker's first record
    link_bytes_s: float = 1.25e9  # of a node: 10 Gbit/s
    disk_bytes_s: float = 2.5e9  # of the disk, for all nodes together
    jitter: float = 0.0  # standard deviation of a worker's speed

    @property
    def shards(self) -> int:
        return self.nodes * self.workers


def moved_bytes(study: Study, cluster: Cluster) -> int:
    """Over the disk: the map written once, read by every node and by the one that merges; the queries' results twice."""
    return study.places * study.place_bytes * (2 + cluster.nodes) + 2 * study.queries * study.query_bytes


def on_paper_s(study: Study, cluster: Cluster) -> float:
    """The three stages one after the other, each as long as its largest share and what it reads and writes."""
    map_bytes = study.places * study.place_bytes
    each_bytes_s = min(cluster.link_bytes_s, cluster.disk_bytes_s / cluster.nodes)
    places = -(-study.places // cluster.shards) * study.place_s + map_bytes / cluster.nodes / each_bytes_s
    queries = map_bytes / each_bytes_s + study.prepare_s + -(-study.queries // cluster.shards) * study.query_s
    merging = map_bytes / min(cluster.link_bytes_s, cluster.disk_bytes_s) + study.merge_s
    return 3 * cluster.start_s + places + queries + merging


def simulated_s(study: Study, cluster: Cluster, seed: int = 0) -> float:
    """The same, event by event: nodes that share the disk's bandwidth, workers of unequal speed, three barriers."""
    rng = np.random.default_rng(seed)
    map_bytes, nodes = study.places * study.place_bytes, cluster.nodes

    def work_s(units: int, unit_s: float, once_s: float = 0.0) -> np.ndarray:
        """Of each node the slowest worker's time for its share."""
        bounds = np.arange(cluster.shards + 1) * units // cluster.shards
        speed = np.maximum(0.2, 1 + cluster.jitter * rng.standard_normal(cluster.shards))
        return ((np.diff(bounds) * unit_s + once_s) / speed).reshape(nodes, -1).max(axis=1)

    start = np.full(nodes, cluster.start_s)
    written = np.full(nodes, map_bytes / nodes)
    now = transferred(start + work_s(study.places, study.place_s), written, cluster).max()
    arrived = transferred(now + start, np.full(nodes, float(map_bytes)), cluster)
    now = (arrived + work_s(study.queries, study.query_s, study.prepare_s)).max()
    return float(transferred(now + start[:1], np.array([float(map_bytes)]), cluster)[0] + study.merge_s)


def transferred(start_s: np.ndarray, size_bytes: np.ndarray, cluster: Cluster) -> np.ndarray:
    """When each of several transfers ends that begin at given times and share the disk evenly, none faster than its link."""
    left, end = size_bytes.astype(float).copy(), np.full(len(start_s), np.inf)
    now = float(start_s.min())
    while np.isinf(end).any():
        active = (start_s <= now) & np.isinf(end)
        rate = min(cluster.link_bytes_s, cluster.disk_bytes_s / max(1, active.sum()))
        following = [t for t in start_s if t > now] + [now + left[active].min() / rate if active.any() else np.inf]
        then = min(following)
        left[active] -= rate * (then - now)
        now = float(then)
        end[active & (left <= 1e-6 * size_bytes)] = now
    return end


# 10^5 places, 10^4 queries; seconds of one core, measured on 2000 and 20,000 places: 4 ms to render an image; Radon and
# poc_band: 2.8 ms to describe one, 0.77 ms to prepare a place, 1.8 us to compare with one; Fourier: 0.3 ms, 0.11 ms, 1.2 us
RADON = Study(100_000, 10_000, place_s=0.0068, query_s=0.184, prepare_s=77.0, merge_s=15.0, place_bytes=124_560)
FOURIER = Study(100_000, 10_000, place_s=0.0043, query_s=0.125, prepare_s=11.0, merge_s=15.0, place_bytes=20_480)
SIZES = ((1, 2), (1, 16), (4, 16), (16, 16), (64, 1), (64, 16))  # nodes, and workers of each


def table(study: Study, jitter: float = 0.05) -> str:
    """Of clusters of several sizes: time on paper and simulated, share of what the workers allow, bytes moved."""
    rows = [
        "| nodes x workers | on paper | simulated | of what the workers allow | over the disk |",
        "|---|---|---|---|---|",
    ]
    for nodes, workers in SIZES:
        cluster = Cluster(nodes, workers)
        paper, simulated = on_paper_s(study, cluster), simulated_s(study, replace(cluster, jitter=jitter))
        share = study.alone_s / cluster.shards / simulated
        moved = moved_bytes(study, cluster) / 1e9
        rows.append(f"| {nodes} x {workers} | {paper:.0f} s | {simulated:.0f} s | {share:.2f} | {moved:.0f} GB |")
    return "\n".join(rows)
