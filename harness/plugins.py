"""The public names for plug-ins: trackers, metrics, drivers, sensors, readers and export formats.

Only the names in ``harness``, ``harness.plugins`` and ``mmpf`` are stable: import them from there, not from deeper
modules. The names stand in ``plugins.pyi`` and are imported on first use, so that the import alone costs nothing.
"""

from mmpf.registry import names_of_stub

__getattr__, __all__ = names_of_stub(__name__, __file__)


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
