"""What a surface does with light: BRDF models, their expressions, hemisphere integrals."""

import lazy_loader

__getattr__, __dir__, __all__ = lazy_loader.attach_stub(__name__, __file__)
