"""What a model lacks: where it parts from the data, which effect is missing, and what to measure next."""

import sys
from types import ModuleType
from typing import Any

from identification.diagnose.diagnosis import Diagnosis
from identification.diagnose.workflow import diagnose

__all__ = ["Diagnosis", "diagnose"]


class _Package(ModuleType):
    """`identification.diagnose` is the function, and, once a module of this package has been imported, the package:
    the one does as the other."""

    def __call__(self, *args: Any, **settings: Any) -> Diagnosis:
        return diagnose(*args, **settings)


sys.modules[__name__].__class__ = _Package
