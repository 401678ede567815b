"""Where a run computes: on the processor, or what a plugin can of it on a device (`device=cuda`)."""

from __future__ import annotations

import logging
from typing import Any

from omnilab.errors import ConfigError, did_you_mean
from omnilab.hooks import Accelerator
from omnilab.runner.config import Run, components_of, named_components
from omnilab.runner.registry import CPU, Registry

OFFLOADED = ("descriptor", "distance")  # what takes the time that a device saves

log = logging.getLogger("omnilab")


def check_device(device: str, registry: Registry) -> None:
    """ConfigError unless some plugin serves a device of that name; whether it is there is another matter."""
    name = device.partition(":")[0]
    if device != CPU and name not in registry.devices:
        known = [CPU, *sorted(registry.devices)]
        raise ConfigError(
            f"device={device} is not served by any plugin; there is {', '.join(known)}"
            + did_you_mean(name, known, "device=")
            + registry.failed
        )


def open_device(device: str, registry: Registry) -> Accelerator | None:
    """The device of a run, None for the processor; ConfigError if it cannot be had."""
    check_device(device, registry)
    return None if device == CPU else registry.devices[device.partition(":")[0]](device)


def on_device(component: Any, accelerator: Accelerator | None) -> tuple[Any, str]:
    """What computes in a component's place, and on what device; the component itself and "" where that is the processor."""
    made = None if accelerator is None else accelerator.accelerated(component)
    return (component, "") if accelerator is None or made is None else (made, accelerator.computed_on)


def placed_components(run: Run, registry: Registry, accelerator: Accelerator | None) -> dict[str, dict[str, str]]:
    """`named_components`; in a run that has a device, each also says on what it is `computed_on`."""
    named = named_components(run, registry)
    if accelerator is not None:
        for slot, _, value in components_of(vars(run)):
            if slot in named:
                named[slot]["computed_on"] = on_device(value, accelerator)[1] or CPU
    return named


def say_what_stays(run: Run, named: dict[str, dict[str, str]]) -> None:
    """One line that names the descriptors and distances of a run with a device that are computed on the processor."""
    kinds = {slot: kind for slot, kind, _ in components_of(vars(run))}
    stay = [f"{kinds[slot]} '{each['name']}'" for slot, each in named.items()
            if kinds[slot] in OFFLOADED and each.get("computed_on") == CPU]  # fmt: skip
    if stay:
        log.warning("device=%s computes no %s; the processor does", run.device, " and no ".join(dict.fromkeys(stay)))
