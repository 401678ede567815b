"""Localizers.

What is imported here is registered, by the name of its class in snake case.
"""

from omnilab_appearance.localizers.bayes_filter import BayesFilter as BayesFilter
from omnilab_appearance.localizers.gower import Gower as Gower
from omnilab_appearance.localizers.hierarchical import Hierarchical as Hierarchical
from omnilab_appearance.localizers.interpolated import Interpolated as Interpolated
from omnilab_appearance.localizers.nearest import Nearest as Nearest
from omnilab_appearance.localizers.route_filter import RouteFilter as RouteFilter
from omnilab_appearance.localizers.sequence_matching import SequenceMatching as SequenceMatching
from omnilab_appearance.localizers.smacof import Smacof as Smacof
from omnilab_appearance.localizers.spring import Spring as Spring
