"""Which topic of a log is played back, and the sentences about those that are not."""

from __future__ import annotations

from omnilab.errors import ConfigError, DataError
from omnilab_recordings.bags.decoding import IMAGES
from omnilab_recordings.bags.log_index import LogIndex
from omnilab_recordings.bags.pixels import unread


def image_topic(log: LogIndex, topic: str | None) -> str:
    """The topic of the images: the one that is named, or the only one there is."""
    if topic is not None:
        return _named(log, topic)
    readable = [name for name, found in log.images.items() if unread(found.first) is None]
    if len(readable) == 1:
        return readable[0]
    if readable:
        listed = ", ".join(_described(log, name) for name in sorted(readable))
        raise ConfigError(
            f"{log.path} has images on {len(readable)} topics, {listed}; give sensor.topic={min(readable)}, or another of them"
        )
    if log.images:
        name = next(iter(log.images))
        raise DataError(
            f"{log.path} has no images that are read: those of {name} are of {unread(log.images[name].first)}"
        )
    if log.topics:
        raise DataError(f"{log.path} has no images ({', '.join(IMAGES)}); its topics are {log.listed()}{_end(log)}")
    raise DataError(f"{log.path} holds no messages{_end(log)}")


def _named(log: LogIndex, topic: str) -> str:
    if topic in log.images:
        if (reason := unread(log.images[topic].first)) is not None:
            raise DataError(f"{log.path}: the images of {topic} are of {reason}")
        return topic
    if topic in log.topics:
        raise ConfigError(f"topic={topic} is of {log.topics[topic]}, no images; {_images(log)}")
    raise ConfigError(f"topic={topic} is not in {log.path}; {_images(log)}")


def _images(log: LogIndex) -> str:
    if log.images:
        return f"images are on {', '.join(sorted(log.images))}"
    return f"it has no images, its topics are {log.listed()}"


def _described(log: LogIndex, topic: str) -> str:
    found = log.images[topic]
    size = f"{found.first.width} x {found.first.height} " if found.first.width else ""
    return f"{topic} ({len(found.places)} of {size}{found.first.encoding})"


def _end(log: LogIndex) -> str:
    return "" if log.damage is None else f"; of the file the rest is damaged ({log.damage})"
