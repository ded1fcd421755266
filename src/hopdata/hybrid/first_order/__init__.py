"""First-order analysis: saltation matrices, Bouligand derivatives, smoothness."""

from hopdata.hybrid.first_order.crossings import NoDerivativeError
from hopdata.hybrid.first_order.saltation import (
    NotTransversalError,
    bouligand_derivative,
    project_onto_section,
    saltation_matrix,
)
from hopdata.hybrid.first_order.segments import derivative_without_saltation
from hopdata.hybrid.first_order.smoothness import check_c1

__all__ = [
    "NoDerivativeError",
    "NotTransversalError",
    "bouligand_derivative",
    "check_c1",
    "derivative_without_saltation",
    "project_onto_section",
    "saltation_matrix",
]
