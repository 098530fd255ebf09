"""The Modified Mixture Particle Filter and its motion models; a library on its own.

The public names stand in ``__init__.pyi`` and are imported on first use, so that ``import mmpf`` costs nothing.
"""

from mmpf.registry import names_of_stub

__getattr__, __all__ = names_of_stub(__name__, __file__)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
