"""Certificates: each property of models and of tables, with a bound on the error of its residual."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
