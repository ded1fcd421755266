"""First-order information: saltation, Bouligand derivatives, and what they say of smoothness."""

from hopdata.hybrid.first_order.saltation import (
    BouligandDerivative,
    CrossingOrder,
    NotTransversalError,
    bouligand_derivative,
    project_onto_section,
    saltation_matrix,
    saltation_product,
)
from hopdata.hybrid.first_order.selection import EventSelection, check_event_selected
from hopdata.hybrid.first_order.smoothness import SmoothnessReport, check_c1

__all__ = [
    "BouligandDerivative",
    "CrossingOrder",
    "EventSelection",
    "NotTransversalError",
    "SmoothnessReport",
    "bouligand_derivative",
    "check_c1",
    "check_event_selected",
    "project_onto_section",
    "saltation_matrix",
    "saltation_product",
]
