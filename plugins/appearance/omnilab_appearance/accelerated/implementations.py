"""Which components compute on a device of torch, and by which class."""

from __future__ import annotations

from typing import Any

from omnilab_appearance.accelerated import comparing, describing
from omnilab_appearance.descriptors.fourier_signature import FourierSignature
from omnilab_appearance.descriptors.gist import Gist
from omnilab_appearance.descriptors.hog import Hog
from omnilab_appearance.descriptors.radon import Radon
from omnilab_appearance.distances.cosine import Cosine
from omnilab_appearance.distances.euclidean import Euclidean
from omnilab_appearance.distances.pearson import Pearson
from omnilab_appearance.distances.poc import Poc
from omnilab_appearance.distances.poc_band import PocBand
from omnilab_appearance.distances.weighted import Cityblock

ON_TORCH: dict[type[Any], type[Any]] = {
    FourierSignature: describing.FourierSignatureOnTorch,
    Gist: describing.GistOnTorch,
    Hog: describing.HogOnTorch,
    Radon: describing.RadonOnTorch,
    Cityblock: comparing.CityblockOnTorch,
    Cosine: comparing.CosineOnTorch,
    Euclidean: comparing.EuclideanOnTorch,
    Pearson: comparing.PearsonOnTorch,
    Poc: comparing.PocOnTorch,
    PocBand: comparing.PocBandOnTorch,
}
