"""The drivers that come along; importing this registers them."""

from harness.decisions.drivers import hdm, idm, mobil

__all__ = ["hdm", "idm", "mobil"]
