"""Devices of torch: which there are, and which components compute there."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

from omnilab.errors import ConfigError

INSTALL = "pip install 'omnilab-appearance[gpu]'"


@dataclass(frozen=True)
class TorchDevice:
    """A device, opened."""

    device: Any  # a torch.device
    computed_on: str

    def accelerated(self, component: Any) -> Any | None:
        """One of the same settings that computes on the device; None for a component that has none."""
        from omnilab_appearance.accelerated.implementations import ON_TORCH

        if (cls := ON_TORCH.get(type(component))) is None:
            return None
        made = object.__new__(cls)
        vars(made).update(vars(component), device=self.device)
        return made


def open_device(name: str) -> TorchDevice:
    """The device of that name, such as `cuda:1`; ConfigError in one sentence if it cannot be had."""
    if not re.fullmatch(r"cuda(:\d{1,3})?|torch:cpu", name):
        raise ConfigError(f"device={name} is no device that torch computes on here; give cuda, cuda:1 or torch:cpu")
    try:
        import torch
    except (ImportError, OSError) as error:
        raise ConfigError(
            f"device={name} needs torch, which cannot be imported ({error}); {INSTALL}, or give device=cpu"
        ) from error
    device = torch.device(name.removeprefix("torch:"))
    if device.type == "cpu":
        return TorchDevice(device, f"the processor, by torch {torch.__version__}")
    if not torch.cuda.is_available():
        raise ConfigError(
            f"device={name} is not there: torch {torch.__version__} finds no GPU{_why(torch)}; give device=cpu"
        )
    if (device.index or 0) >= torch.cuda.device_count():
        last = torch.cuda.device_count() - 1
        raise ConfigError(f"device={name} is not there: the last one is cuda:{last}; give that, or another up to it")
    gpu = f"{torch.cuda.get_device_name(device)}, by torch {torch.__version__}, CUDA {torch.version.cuda}"
    return TorchDevice(device, gpu)


def _why(torch: Any) -> str:
    return (
        ""
        if torch.version.cuda
        else ", for it was built without CUDA (pip install --force-reinstall torch brings one with it)"
    )
