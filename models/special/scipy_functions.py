"""SciPy's special functions of NumPy arrays."""

from gonio.models.special.scipy_parts import parts

NAMES = ("chdtrc", "exprel", "gammainc", "log_ndtr", "ndtr", "ndtri", "stdtrit")

chdtrc, exprel, gammainc, log_ndtr, ndtr, ndtri, stdtrit = parts("scipy.special", "_ufuncs", *NAMES)
