from .albedo import directional_albedo as directional_albedo
from .brdf import AbstractBRDF as AbstractBRDF
from .errors import GonioError as GonioError
from .evaluation import evaluate as evaluate
from .expression.builder import build as build
from .expression.builder import to_expression as to_expression
from .geometry.directions import Direction as Direction
