from .batch import fit_many as fit_many
from .fit_table import fit as fit
from .result import FitResult as FitResult
