"""Interaction potentials of peridynamics: one line of energy in, exact forces and solved bodies out.

>>> import numpy as np, piola
>>> spring = piola.Law("potential spring\\nparameter c\\npsi(l) = c/2*L*(l/L - 1)^2\\n", c=2.0)
>>> spring.d1(np.array([1.0, 1.5]), 1.0)
array([0., 1.])
"""

from importlib.metadata import version as _version

from ._errors import Error, NotConverged, PiolaWarning
from ._frames import Frame
from ._law import Law, library
from ._scene import Body, Energy, Result, Scene, Step
from ._sweep import Sweep, sweep

__version__ = _version("piola")

__all__ = [
    "Body",
    "Energy",
    "Error",
    "Frame",
    "Law",
    "NotConverged",
    "PiolaWarning",
    "Result",
    "Scene",
    "Step",
    "Sweep",
    "library",
    "sweep",
]
